//! The live view over HTTP: a page, its events, metrics, faults. Nothing is changed by a request.

use super::view::Live;
use std::io::{self, Write};
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, StatusCode};

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
/// Loads nothing from elsewhere, and is shown in no other page.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; connect-src 'self'; \
                      frame-ancestors 'none'";
/// Between two states that a page is sent, at least and at most.
const LEAST_PAUSE: Duration = Duration::from_millis(200);
const MOST_PAUSE: Duration = Duration::from_secs(1);
/// Pages that are open at once.
const MOST_LISTENERS: usize = 32;

/// What a request asks for.
enum Asked {
    Page,
    Script,
    Events,
    Metrics,
    Faults,
}

impl Asked {
    fn of(path: &str) -> Option<Asked> {
        Some(match path {
            "/" => Asked::Page,
            "/page.js" => Asked::Script,
            "/events" => Asked::Events,
            "/metrics" => Asked::Metrics,
            "/faults.json" => Asked::Faults,
            _ => return None,
        })
    }

    /// Page and script say nothing of printheads.
    fn is_data(&self) -> bool {
        !matches!(self, Asked::Page | Asked::Script)
    }
}

/// Answers until the process ends.
pub fn serve(server: &tiny_http::Server, live: &Arc<Live>) {
    let listeners = Arc::new(AtomicUsize::new(0));
    for request in server.incoming_requests() {
        // whoever asked has gone away: nobody is left to tell
        let _ = answer(request, live, &listeners);
    }
}

fn answer(request: Request, live: &Arc<Live>, listeners: &Arc<AtomicUsize>) -> io::Result<()> {
    let url = request.url().to_owned();
    let (path, query) = url.split_once('?').unwrap_or((&url, ""));
    if *request.method() != Method::Get {
        return refuse(request, 405, "only GET");
    }
    let Some(asked) = Asked::of(path) else {
        return refuse(request, 404, "there are /, /metrics, /faults.json and /events");
    };
    if !is_named_as_here(&request, live) {
        return refuse(request, 403, "another host's name: open it by the address it is served at");
    }
    if asked.is_data() && !live.admits(&token(&request, query)) {
        return refuse(request, 401, "give the token: /?token=..., or Authorization: Bearer ...");
    }
    match asked {
        Asked::Page => say(request, "text/html; charset=utf-8", PAGE.into()),
        Asked::Script => say(request, "text/javascript; charset=utf-8", SCRIPT.into()),
        Asked::Metrics => {
            let text = live.state.metrics(live.behind_bytes());
            say(request, "text/plain; version=0.0.4; charset=utf-8", text)
        }
        Asked::Faults => {
            let text = live.state.faults_as_json(&live.recording).to_string();
            say(request, "application/json", text)
        }
        Asked::Events => {
            if listeners.fetch_add(1, Ordering::Relaxed) >= MOST_LISTENERS {
                listeners.fetch_sub(1, Ordering::Relaxed);
                return refuse(request, 503, "too many pages are open");
            }
            let (live, listeners) = (live.clone(), listeners.clone());
            thread::Builder::new().name("live page".into()).spawn(move || {
                let _ = tell(request.into_writer(), &live);
                listeners.fetch_sub(1, Ordering::Relaxed);
            })?;
            Ok(())
        }
    }
}

/// A page of another name that leads here is another's program in a browser on this machine.
fn is_named_as_here(request: &Request, live: &Live) -> bool {
    if !live.address.ip().is_loopback() {
        return true; // names of machines are not known here; the token decides
    }
    let host = header(request, "Host").unwrap_or_default();
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next(),
        None => host.split(':').next(),
    };
    let name = name.unwrap_or_default();
    name == "localhost" || name.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

fn header(request: &Request, name: &'static str) -> Option<String> {
    let found = request.headers().iter().find(|header| header.field.equiv(name))?;
    Some(found.value.as_str().to_owned())
}

/// As the request gives it; empty: it gives none.
fn token(request: &Request, query: &str) -> String {
    let of_header = header(request, "Authorization");
    let bearer = of_header.as_deref().and_then(|value| value.strip_prefix("Bearer "));
    let of_query = query.split('&').find_map(|pair| pair.strip_prefix("token="));
    bearer.or(of_query).unwrap_or_default().to_owned()
}

fn say(request: Request, kind: &str, text: String) -> io::Result<()> {
    let mut response = Response::from_string(text);
    let headers = [
        ("Content-Type", kind),
        ("Content-Security-Policy", POLICY),
        ("Cache-Control", "no-store"),
        ("X-Content-Type-Options", "nosniff"),
        ("Referrer-Policy", "no-referrer"),
    ];
    for (name, value) in headers {
        if let Ok(header) = Header::from_bytes(name, value) {
            response.add_header(header);
        }
    }
    request.respond(response)
}

fn refuse(request: Request, status: u16, why: &str) -> io::Result<()> {
    let response = Response::from_string(format!("{why}\n"));
    request.respond(response.with_status_code(StatusCode(status)))
}

/// Server-sent events: the state, again whenever it has changed, until the recording ends or nobody reads.
fn tell(mut out: Box<dyn Write + Send>, live: &Live) -> io::Result<()> {
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
                X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\nretry: 1000\n\n";
    out.write_all(head.as_bytes())?;
    let mut seen = 0;
    loop {
        let (version, ended) = live.state.wait(seen, MOST_PAUSE);
        seen = version;
        // also where nothing has changed: it tells that somebody is there
        let state = live.state.as_json(&live.recording, live.behind_bytes());
        write!(out, "data: {state}\n\n")?;
        out.flush()?;
        if ended {
            return Ok(());
        }
        thread::sleep(LEAST_PAUSE);
    }
}
