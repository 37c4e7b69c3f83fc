//! Who is connected: so many at once and no more, each on a thread of its own.

use super::answers;
use super::client::Client;
use super::request::{Request, Status};
use super::seat::Seat;
use super::view::Live;
use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::Duration;

/// Connections at once; of them so many pages, so that there is room for who asks once.
const MOST_CONNECTIONS: usize = 64;
const MOST_PAGES: usize = 32;
/// To send a request.
const ASKING: Duration = Duration::from_secs(5);
/// After a failure of the system's, such as too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// Answers until the process ends.
pub fn accept(listener: &TcpListener, live: &Arc<Live>) {
    let (connections, pages) = (Arc::default(), Arc::default());
    for stream in listener.incoming() {
        let Ok(stream) = stream else {
            thread::sleep(PAUSE);
            continue;
        };
        let mut client = Client::new(stream);
        let Some(seat) = Seat::take(&connections, MOST_CONNECTIONS) else {
            // what is sent first waits for nobody
            let _ = answers::refuse(&mut client, Status::NoRoom);
            continue;
        };
        let (live, pages) = (live.clone(), Arc::clone(&pages));
        let answer = move || {
            // whoever asked has gone away: nobody is left to tell
            let _ = hear(client, &live, &pages);
            drop(seat);
        };
        if thread::Builder::new().name("live client".into()).spawn(answer).is_err() {
            thread::sleep(PAUSE);
        }
    }
}

fn hear(mut client: Client, live: &Live, pages: &Arc<AtomicUsize>) -> io::Result<()> {
    client.give(ASKING);
    match Request::read(&mut client)? {
        Ok(request) => {
            let page = || Seat::take(pages, MOST_PAGES);
            answers::answer(&request, &mut client, live, page)?;
        }
        Err(status) => answers::refuse(&mut client, status)?,
    }
    client.part();
    Ok(())
}
