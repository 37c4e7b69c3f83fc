//! A client's connection, with a deadline for all reads and writes together ([`Client`]), so that a
//! client that sends or reads one byte at a time cannot hold its thread for long; a limit on how
//! many clients are served at once ([`Seat`]); and the head of the HTTP request that a client sends
//! ([`Request`]). Used by `connections` and `answers`.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time, and below it number of bytes, for reading what the client still sends. If it were left unread, the
/// system could reset the connection, and the answer would be lost.
const CLOSING_TIME: Duration = Duration::from_secs(1);
const MOST_UNREAD: u64 = 64 << 10;

/// A client, and the time at which its reads and writes fail.
pub struct Client {
    stream: TcpStream,
    until: Instant,
}

impl Client {
    /// A client whose deadline has passed: [`Client::set_deadline`] is called before anything is read or
    /// written.
    pub fn new(stream: TcpStream) -> Client {
        Client { stream, until: Instant::now() }
    }

    /// Sets the deadline: once `time` has passed, reads and writes fail, however many there were.
    pub fn set_deadline(&mut self, time: Duration) {
        self.until = Instant::now() + time;
    }

    /// The time until the deadline; an error once it has passed.
    fn remaining(&self) -> io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }

    /// Closes the connection after a complete answer.
    pub fn close(mut self) {
        self.set_deadline(CLOSING_TIME);
        if self.stream.shutdown(Shutdown::Write).is_ok() {
            // the result does not matter, as the answer has been sent
            let _ = io::copy(&mut (&mut self).take(MOST_UNREAD), &mut io::sink());
        }
    }
}

impl Read for Client {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.remaining()?))?;
        self.stream.read(into)
    }
}

impl Write for Client {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.remaining()?))?;
        self.stream.write(from)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// One of a limited number of seats, which is given back when it is dropped: the references to one
/// value are counted.
pub type Seat = Arc<()>;

/// Takes a seat beside those of `all`; `None` if `most` are taken.
pub fn take_seat(all: &Seat, most: usize) -> Option<Seat> {
    let seat = all.clone();
    // `all` is a reference that is no seat
    (Arc::strong_count(all) <= most + 1).then_some(seat)
}

/// Most bytes of a request's head: browsers send less.
const MOST_BYTES: usize = 8 << 10;
const MOST_HEADERS: usize = 64;

/// The parts of a request that matter here.
pub struct Request {
    pub is_get: bool,
    pub path: String,
    /// The name by which the client calls this machine.
    pub host: String,
    /// The token, from the header or else from the query; empty if there is none.
    pub token: String,
}

/// Why a request is refused: the status line, and the reason in words.
pub type Refusal = [&'static str; 2];

pub const NO_HTTP: Refusal = ["400 Bad Request", "no HTTP"];
pub const NO_TOKEN: Refusal =
    ["401 Unauthorized", "give the token: /?token=..., or Authorization: Bearer ..."];
pub const OTHER_HOST: Refusal =
    ["403 Forbidden", "another host's name: open it by the address it is served at"];
pub const NO_SUCH_PATH: Refusal =
    ["404 Not Found", "there are /, /metrics, /faults.json and /events"];
/// HTTP requires the header `Allow` with this status.
pub const NOT_GET: Refusal = ["405 Method Not Allowed\r\nAllow: GET", "only GET"];
pub const TOO_LARGE: Refusal =
    ["431 Request Header Fields Too Large", "more headers than are read here"];
pub const NO_ROOM: Refusal = ["503 Service Unavailable", "too many are connected: come again"];

impl Request {
    /// Reads the head of a request, and parses it; the inner error says why it is refused.
    ///
    /// # Errors
    /// The client is slow, or has gone.
    pub fn read(client: &mut Client) -> io::Result<Result<Request, Refusal>> {
        // the head is parsed again after each piece until it is complete
        let mut head = Vec::new();
        let mut piece = [0; 1024];
        loop {
            let n = client.read(&mut piece)?;
            if n == 0 {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            head.extend_from_slice(&piece[..n]);
            match Request::parse(&head).transpose() {
                Some(parsed) => return Ok(parsed),
                None if head.len() >= MOST_BYTES => return Ok(Err(TOO_LARGE)),
                None => {}
            }
        }
    }

    /// Parses the head of a request; `None` if it is not complete yet.
    fn parse(head: &[u8]) -> Result<Option<Request>, Refusal> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        match parsed.parse(head) {
            Ok(status) if status.is_partial() => return Ok(None),
            Ok(_) => {}
            Err(httparse::Error::TooManyHeaders) => return Err(TOO_LARGE),
            Err(_) => return Err(NO_HTTP),
        }
        let header = |name: &str| {
            let found = parsed.headers.iter().find(|header| header.name.eq_ignore_ascii_case(name));
            found.map_or(String::new(), |of| String::from_utf8_lossy(of.value).into_owned())
        };
        let url = parsed.path.unwrap_or_default();
        let (path, query) = url.split_once('?').unwrap_or((url, ""));
        let authorization = header("Authorization");
        let bearer = authorization
            .split_once(' ')
            .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("Bearer"))
            .map(|(_, token)| token.trim());
        let of_query = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        Ok(Some(Request {
            is_get: parsed.method == Some("GET"),
            path: path.to_owned(),
            host: header("Host"),
            token: bearer.or(of_query).unwrap_or_default().to_owned(),
        }))
    }
}
