//! Answers to requests. In: a request that was read, its client, and what is known of the recording
//! ([`Live`]), from `connections`. Out: the answer, written to the client. No request changes
//! anything.
//!
//! ```text
//! /             the page                              without token
//! /page.js      its script                            without token
//! /events       the state again and again, as server-sent events, for the page; stays connected
//! /metrics      for Prometheus
//! /faults.json  the open faults
//! ```

use super::client::{
    Client, NO_ROOM, NO_SUCH_PATH, NO_TOKEN, NOT_GET, OTHER_HOST, Refusal, Request, take_seat,
};
use super::port::Live;
use std::io::{self, Write};
use std::net::IpAddr;
use std::thread;
use std::time::Duration;

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
/// Content security policy: the page loads nothing from elsewhere, and no other page can embed it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; connect-src 'self'; \
                      frame-ancestors 'none'";
/// Most connections that are pages, which stay connected, so that there is room for single requests.
const MOST_PAGES: usize = 32;
/// Least time between two states that are sent to a page.
const LEAST_PAUSE: Duration = Duration::from_millis(200);
/// Longest wait for a change before the state is sent anyway.
const MOST_PAUSE: Duration = Duration::from_secs(1);
/// Time in which a client has to take an answer or a state. A slower client is disconnected; a page then
/// connects again by itself.
const ANSWER_TIME: Duration = Duration::from_secs(10);

/// Answers one request. The error is one of the connection: the client is slow or gone.
pub fn answer(request: &Request, client: &mut Client, live: &Live) -> io::Result<()> {
    if !request.is_get {
        return refuse(client, NOT_GET);
    }
    let path = request.path.as_str();
    let needs_token = match path {
        "/" | "/page.js" => false, // page and script hold nothing about printheads
        "/events" | "/metrics" | "/faults.json" => true,
        _ => return refuse(client, NO_SUCH_PATH),
    };
    // who may ask: the path is known, the name of the host is ours, and the token is right
    if !is_named_as_here(&request.host, live) {
        return refuse(client, OTHER_HOST);
    }
    if needs_token && !live.admits(&request.token) {
        return refuse(client, NO_TOKEN);
    }
    let state = &live.state;
    let (kind, text) = match path {
        "/" => ("text/html; charset=utf-8", PAGE.into()),
        "/page.js" => ("text/javascript; charset=utf-8", SCRIPT.into()),
        "/metrics" => {
            ("text/plain; version=0.0.4; charset=utf-8", state.metrics(live.behind_bytes()))
        }
        "/faults.json" => ("application/json", state.faults_as_json(&live.recording).to_string()),
        // /events, for as long as there are seats for pages
        _ => match take_seat(&live.pages, MOST_PAGES) {
            Some(_seat) => return send_events(client, live),
            None => return refuse(client, NO_ROOM),
        },
    };
    write_whole(client, "200 OK", kind, &text)
}

/// Whether the request's `Host` is a name of this machine, if only this machine is served. Otherwise a
/// foreign web page whose name resolves to this address could read the answers in a browser (DNS rebinding).
fn is_named_as_here(host: &str, live: &Live) -> bool {
    if !live.port.address.ip().is_loopback() {
        return true; // names of machines are not known here; the token decides
    }

    // the name without its port; an IPv6 address stands in brackets
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next(),
        None => host.split(':').next(),
    };
    let name = name.unwrap_or_default();
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Sends a refusal with its reason.
pub fn refuse(client: &mut Client, [line, why]: Refusal) -> io::Result<()> {
    write_whole(client, line, "text/plain; charset=utf-8", &format!("{why}\n"))
}

/// The head of an answer, without its length.
fn head(status: &str, kind: &str) -> String {
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Security-Policy: {POLICY}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nConnection: close\r\n"
    )
}

/// Sends a whole answer: `status` line, content type `kind`, and text.
fn write_whole(client: &mut Client, status: &str, kind: &str, text: &str) -> io::Result<()> {
    client.set_deadline(ANSWER_TIME);
    let whole = format!("{}Content-Length: {}\r\n\r\n{text}", head(status, kind), text.len());
    client.write_all(whole.as_bytes())
}

/// Sends the state as server-sent events: again whenever it has changed, until the recording ends or the
/// client is gone.
fn send_events(client: &mut Client, live: &Live) -> io::Result<()> {
    client.set_deadline(ANSWER_TIME);
    let begin = format!("{}\r\nretry: 1000\n\n", head("200 OK", "text/event-stream"));
    client.write_all(begin.as_bytes())?;
    let mut seen = 0;
    loop {
        let (version, ended) = live.state.wait(seen, MOST_PAUSE);
        seen = version;
        // the state is sent even if nothing has changed, so that the page knows that the connection lives
        let state = live.state.as_json(&live.recording, live.behind_bytes());
        client.set_deadline(ANSWER_TIME);
        client.write_all(format!("data: {state}\n\n").as_bytes())?;
        if ended {
            return Ok(());
        }
        thread::sleep(LEAST_PAUSE);
    }
}
