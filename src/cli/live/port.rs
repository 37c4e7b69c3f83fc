//! The live view that is served: the address and the token, which are checked, and the port, which is bound,
//! before anything else is done; and what the threads of the view share.

use super::client::Seat;
use super::state::State;
use crate::cli::exit::Failure;
use crate::pipeline::Control;
use inkling_io::regular_file;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

/// Least number of characters of a token: shorter ones can be guessed.
const LEAST_TOKEN: usize = 16;
/// Most bytes of the token's file: a longer file is not one of a token.
const MOST_TOKEN: u64 = 1024;

/// Time that open pages get to be told of the end before the process goes on.
const END_NOTICE: Duration = Duration::from_millis(300);

/// A bound port. From binding on, the system queues clients until `connections::start` accepts them.
#[derive(Debug)]
pub struct BoundPort {
    pub listener: TcpListener,
    pub address: SocketAddr,
    /// The secret that a client must give; `None`: only this machine can look.
    pub token: Option<String>,
}

/// Checks the options and binds the port; `None` if no live view is asked for. `address`: `127.0.0.1:8080` or
/// `localhost:8080`; `token`: the file that holds the token; `follow`: whether `--follow` is given.
///
/// # Errors
/// A usage failure if the options have no effect, if the address has no port or cannot be resolved, if the
/// token's file cannot be read or its token is too short or has other characters, or if other machines could
/// look without a token; a failure if the port cannot be bound.
pub fn check(
    address: Option<&str>,
    token: Option<&Path>,
    follow: bool,
) -> Result<Option<BoundPort>, Failure> {
    let address = match (address, token) {
        (Some(address), _) => address,
        (None, Some(_)) => {
            return Err(Failure::usage("--serve-token: has no effect here: add --serve"));
        }
        (None, None) => return Ok(None),
    };
    if !follow {
        return Err(Failure::usage(
            "--serve: shows a recording that is being written: add --follow; `inkling report` makes a page of what \
             is finished",
        ));
    }
    let token = token.map(read_token).transpose()?;
    let addresses = resolve(address)?;
    if let Some(open) = addresses.iter().find(|of| token.is_none() && !of.ip().is_loopback()) {
        let port = open.port();
        return Err(Failure::usage(format!(
            "--serve {address}: whoever reaches this machine could look: serve 127.0.0.1:{port}, or give \
             --serve-token FILE with a secret of {LEAST_TOKEN} characters or more"
        )));
    }
    let failed = |e| Failure::new(format!("--serve {address}: cannot listen: {e}"));
    let listener = TcpListener::bind(addresses.as_slice()).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    Ok(Some(BoundPort { listener, address, token }))
}

/// All addresses of a name, IPv4 first: a port is bound at the first address that allows it, and for this
/// machine most people type 127.0.0.1.
fn resolve(address: &str) -> Result<Vec<SocketAddr>, Failure> {
    let found = address.to_socket_addrs().map_err(|e| {
        let such = "an address or a name and a port, such as 127.0.0.1:8080";
        Failure::usage(format!("--serve {address}: give {such} ({e})"))
    })?;
    let mut addresses: Vec<SocketAddr> = found.collect();
    addresses.sort_by_key(SocketAddr::is_ipv6);
    Ok(addresses)
}

/// Reads a token from its file: one line, long enough, of characters that need no escape in a URL.
fn read_token(path: &Path) -> Result<String, Failure> {
    let failed = |what: String| Failure::usage(format!("--serve-token {}: {what}", path.display()));
    let text = regular_file::read(path, MOST_TOKEN).map_err(|e| failed(e.to_string()))?;
    let token = String::from_utf8_lossy(&text).trim().to_owned();
    let is_plain = token.bytes().all(|c| c.is_ascii_alphanumeric() || b"-._~".contains(&c));
    if !is_plain || token.len() < LEAST_TOKEN {
        let such = "or more letters, digits, `-`, `.`, `_` or `~`";
        return Err(failed(format!("give one line of {LEAST_TOKEN} {such}")));
    }
    Ok(token)
}

/// Everything that the threads of the live view share.
pub struct Live {
    /// What is known of the recording.
    pub state: State,
    pub port: BoundPort,
    /// Name of the recording's file, and its path.
    pub recording: String,
    pub path: PathBuf,
    /// Tells how far the recording was read.
    pub control: Arc<Control>,
    /// The seats of clients that are pages, which stay connected.
    pub pages: Seat,
}

impl Live {
    /// Tells open pages that the judging has ended, also if it failed or was interrupted. Always waits 300 ms
    /// (`END_NOTICE`), whether pages are open or not.
    pub fn end(&self) {
        self.state.end();
        thread::sleep(END_NOTICE);
    }

    /// Number of bytes of the recording that were written and not read yet.
    pub fn behind_bytes(&self) -> u64 {
        let written = std::fs::metadata(&self.path).map_or(0, |of| of.len());
        written.saturating_sub(self.control.bytes_read.load(Ordering::Relaxed))
    }

    /// Whether a token is the right one. The comparison takes the same time wherever the first difference
    /// lies, so that a token cannot be guessed piece by piece.
    pub fn admits(&self, given: &str) -> bool {
        let Some(token) = &self.port.token else { return true };
        let differ = token.bytes().zip(given.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        differ == 0 && token.len() == given.len()
    }
}
