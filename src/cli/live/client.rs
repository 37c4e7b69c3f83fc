//! A client's connection, with a deadline for all reads and writes together ([`Client`]), so that a
//! client that sends or reads one byte at a time cannot hold its thread for long; a limit on how
//! many clients are served at once ([`Seat`]); and the head of the HTTP request that a client sends
//! ([`Request`]). Used by `connections` and `answers`.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// After the answer, what the client still sends is read for this time and up to so many bytes. If it were left
/// unread, the
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
        let mut head = Vec::new();
        let mut piece = [0; 1024];
        while !head.windows(4).any(|end| end == b"\r\n\r\n") {
            if head.len() >= MOST_BYTES {
                return Ok(Err(TOO_LARGE));
            }
            match client.read(&mut piece)? {
                0 => return Err(ErrorKind::UnexpectedEof.into()),
                n => head.extend_from_slice(&piece[..n]),
            }
            // every method begins with a capital letter; what speaks TLS may send no line end
            if !head[0].is_ascii_uppercase() {
                return Ok(Err(NO_HTTP));
            }
        }
        Ok(Request::parse(&String::from_utf8_lossy(&head)))
    }

    /// Parses the head of a request: the line of method, URL and version, then a header per line. A
    /// client gets one answer and no body is read, so that no more of HTTP matters.
    fn parse(head: &str) -> Result<Request, Refusal> {
        let mut lines = head.split("\r\n").take_while(|line| !line.is_empty());
        let first: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
        let [method, url, "HTTP/1.0" | "HTTP/1.1"] = first[..] else { return Err(NO_HTTP) };
        let headers: Option<Vec<(&str, &str)>> = lines.map(|line| line.split_once(':')).collect();
        let headers = headers.ok_or(NO_HTTP)?;
        let header = |name: &str| {
            let found = headers.iter().find(|(of, _)| of.eq_ignore_ascii_case(name));
            found.map_or("", |(_, value)| value.trim())
        };
        let (path, query) = url.split_once('?').unwrap_or((url, ""));
        let bearer = header("Authorization")
            .split_once(' ')
            .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("Bearer"))
            .map(|(_, token)| token.trim());
        let of_query = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        Ok(Request {
            is_get: method == "GET",
            path: path.to_owned(),
            host: header("Host").to_owned(),
            token: bearer.or(of_query).unwrap_or_default().to_owned(),
        })
    }
}
