//! The connections of clients: a limited number at once, each on a thread of its own. In: a bound
//! port (`port`), from `replay`. Out: a [`Live`], which `follow` feeds and the threads read. One
//! request is read and answered per connection.

use super::answers;
use super::client::{Client, NO_ROOM, Request, Seat, take_seat};
use super::port::{BoundPort, Live};
use super::state::State;
use crate::cli::exit::Failure;
use crate::pipeline::Control;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Most connections at once.
const MOST_CONNECTIONS: usize = 64;
/// Time in which a client has to send its request.
const REQUEST_TIME: Duration = Duration::from_secs(5);
/// Pause after an error of the system, such as too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// Starts to serve, on threads of its own, until the process ends. `recording`: path of the
/// recording that is followed; `classes`: of the verdicts.
pub fn start(
    port: BoundPort,
    recording: &str,
    classes: Vec<String>,
    control: &Arc<Control>,
) -> Result<Arc<Live>, Failure> {
    let path = PathBuf::from(recording);
    let recording = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let (state, control, pages) = (State::new(classes), control.clone(), Seat::default());
    let live = Arc::new(Live { state, port, recording, path, control, pages });
    let serving = live.clone();
    thread::Builder::new()
        .name("live".into())
        .spawn(move || accept(&serving))
        .map_err(|e| Failure::new(format!("no thread: {e}")))?;
    Ok(live)
}

/// Accepts and answers connections until the process ends.
fn accept(live: &Arc<Live>) {
    let connections = Seat::default();
    for stream in live.port.listener.incoming() {
        let Ok(stream) = stream else {
            thread::sleep(PAUSE);
            continue;
        };
        let mut client = Client::new(stream);
        let Some(seat) = take_seat(&connections, MOST_CONNECTIONS) else {
            // the short answer is written without reading the request, so that this thread does not wait for
            // the client
            let _ = answers::refuse(&mut client, NO_ROOM);
            continue;
        };
        let live = live.clone();
        let answer = move || {
            // an error means that the client is gone, so nobody is left to tell
            let _ = serve(client, &live);
            drop(seat);
        };
        if thread::Builder::new().name("live client".into()).spawn(answer).is_err() {
            thread::sleep(PAUSE);
        }
    }
}

/// Reads one request and answers it.
fn serve(mut client: Client, live: &Live) -> io::Result<()> {
    client.set_deadline(REQUEST_TIME);
    match Request::read(&mut client)? {
        Ok(request) => answers::answer(&request, &mut client, live)?,
        Err(refusal) => answers::refuse(&mut client, refusal)?,
    }
    client.close();
    Ok(())
}
