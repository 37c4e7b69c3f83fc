//! `inkling replay --follow --serve ADDRESS`: what is known of the recording that is being written, in a browser, for
//! Prometheus, and as JSON. On this machine unless told otherwise; elsewhere only with a token.

mod http;
mod state;
mod view;

pub use view::Live;

use super::exit::Failure;
use crate::io::regular_file;
use crate::pipeline::Control;
use state::State;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

/// Of a token: shorter ones can be guessed, longer ones are another file.
const LEAST_TOKEN: usize = 16;
const MOST_TOKEN: u64 = 1024;

/// Where to serve, as the command line asks for it.
#[derive(Clone, Debug)]
pub struct Asked {
    address: SocketAddr,
    token: Option<String>,
}

/// `127.0.0.1:8080`, `localhost:8080`, `[::1]:8080`.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    let wrong = |why: String| format!("{why}: give HOST:PORT, as 127.0.0.1:8080 or localhost:8080");
    let found = text.to_socket_addrs().map_err(|e| wrong(e.to_string()))?;
    let mut found: Vec<SocketAddr> = found.collect();
    found.sort_by_key(|address| !address.is_ipv4()); // of two for one name the one that browsers try everywhere
    found.into_iter().next().ok_or_else(|| wrong("no address of that name".into()))
}

/// What is asked for, if it can be. `token`: a file of it.
pub fn check(
    address: Option<SocketAddr>,
    token: Option<&Path>,
    follow: bool,
) -> Result<Option<Asked>, Failure> {
    let Some(address) = address else {
        return match token {
            Some(_) => Err(Failure::usage("--serve-token: has no effect here: add --serve")),
            None => Ok(None),
        };
    };
    if !follow {
        return Err(Failure::usage(
            "--serve: shows a recording that is being written: add --follow; `inkling report` makes a page of what \
             is finished",
        ));
    }
    let token = token.map(read_token).transpose()?;
    if token.is_none() && !address.ip().is_loopback() {
        return Err(Failure::usage(format!(
            "--serve {address}: whoever reaches this machine could look: serve 127.0.0.1:{}, or give --serve-token \
             FILE with a secret of {LEAST_TOKEN} characters or more",
            address.port()
        )));
    }
    Ok(Some(Asked { address, token }))
}

fn read_token(path: &Path) -> Result<String, Failure> {
    let failed = |what: String| Failure::usage(format!("--serve-token {}: {what}", path.display()));
    let text = regular_file::read(path, MOST_TOKEN).map_err(|e| failed(e.to_string()))?;
    let token = String::from_utf8_lossy(&text).trim().to_owned();
    let is_plain = token.bytes().all(|c| c.is_ascii_alphanumeric() || b"-._~".contains(&c));
    match is_plain && token.len() >= LEAST_TOKEN {
        true => Ok(token),
        false => Err(failed(format!(
            "give one line of {LEAST_TOKEN} or more letters, digits, `-`, `.`, `_` or `~`"
        ))),
    }
}

/// Serves from here on, on a thread of its own.
pub fn start(asked: Asked, recording: &str, control: &Arc<Control>) -> Result<Arc<Live>, Failure> {
    let Asked { address, token } = asked;
    let server = tiny_http::Server::http(address)
        .map_err(|e| Failure::new(format!("--serve {address}: cannot listen: {e}")))?;
    let path = PathBuf::from(recording);
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let live = Arc::new(Live {
        state: State::default(),
        address: server.server_addr().to_ip().unwrap_or(address),
        recording: name,
        path,
        token,
        control: control.clone(),
    });
    let serving = live.clone();
    thread::Builder::new()
        .name("live".into())
        .spawn(move || http::serve(&server, &serving))
        .map_err(|e| Failure::new(format!("no thread: {e}")))?;
    Ok(live)
}
