//! The connections of clients: a limited number at once, each on a thread of its own.

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

/// Most connections at once.
const MOST_CONNECTIONS: usize = 64;
/// Most of them that are pages, which stay connected, so that there is room for single requests.
const MOST_PAGES: usize = 32;
/// Time in which a client has to send its request.
const ASKING: Duration = Duration::from_secs(5);
/// Pause after an error of the system, such as too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// Accepts and answers connections until the process ends.
pub fn accept(listener: &TcpListener, live: &Arc<Live>) {
    let (connections, pages) = (Arc::default(), Arc::default());
    for stream in listener.incoming() {
        let Ok(stream) = stream else {
            thread::sleep(PAUSE);
            continue;
        };
        let mut client = Client::new(stream);
        let Some(seat) = Seat::take(&connections, MOST_CONNECTIONS) else {
            // the short answer is written without reading the request, so that this thread does not wait for
            // the client
            let _ = answers::refuse(&mut client, Status::NoRoom);
            continue;
        };
        let (live, pages) = (live.clone(), Arc::clone(&pages));
        let answer = move || {
            // an error means that the client is gone, so nobody is left to tell
            let _ = hear(client, &live, &pages);
            drop(seat);
        };
        if thread::Builder::new().name("live client".into()).spawn(answer).is_err() {
            thread::sleep(PAUSE);
        }
    }
}

/// Reads one request and answers it.
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
