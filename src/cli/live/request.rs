//! The head of an HTTP request: what is asked for, under what name, with what token.

use super::client::Client;
use std::io::{self, ErrorKind, Read};

/// Browsers send less than one.
const MOST_BYTES: usize = 8 << 10;
const MOST_HEADERS: usize = 64;

pub struct Request {
    pub is_get: bool,
    pub path: String,
    query: String,
    /// What the client calls this machine.
    pub host: String,
    authorization: String,
}

/// Why there is no answer.
#[derive(Clone, Copy)]
pub enum Status {
    NoHttp,
    NoToken,
    OtherHost,
    NoSuchPath,
    NotGet,
    TooLarge,
    NoRoom,
}

impl Status {
    /// Its line, and why.
    pub fn words(self) -> [&'static str; 2] {
        match self {
            Status::NoHttp => ["400 Bad Request", "no HTTP"],
            Status::NoToken => {
                ["401 Unauthorized", "give the token: /?token=..., or Authorization: Bearer ..."]
            }
            Status::OtherHost => {
                ["403 Forbidden", "another host's name: open it by the address it is served at"]
            }
            Status::NoSuchPath => {
                ["404 Not Found", "there are /, /metrics, /faults.json and /events"]
            }
            // which has to say what is allowed
            Status::NotGet => ["405 Method Not Allowed\r\nAllow: GET", "only GET"],
            Status::TooLarge => {
                ["431 Request Header Fields Too Large", "more headers than are read here"]
            }
            Status::NoRoom => ["503 Service Unavailable", "too many are connected: come again"],
        }
    }
}

impl Request {
    /// # Errors
    /// The client is slow, or has gone.
    pub fn read(client: &mut Client) -> io::Result<Result<Request, Status>> {
        let mut head = Vec::new();
        let mut piece = [0; 1024];
        loop {
            let n = client.read(&mut piece)?;
            if n == 0 {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            head.extend_from_slice(&piece[..n]);
            match Request::parse(&head) {
                Ok(None) if head.len() >= MOST_BYTES => return Ok(Err(Status::TooLarge)),
                Ok(None) => {}
                Ok(Some(request)) => return Ok(Ok(request)),
                Err(refused) => return Ok(Err(refused)),
            }
        }
    }

    /// None: more is to come.
    fn parse(head: &[u8]) -> Result<Option<Request>, Status> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        match parsed.parse(head) {
            Ok(status) if status.is_partial() => return Ok(None),
            Ok(_) => {}
            Err(httparse::Error::TooManyHeaders) => return Err(Status::TooLarge),
            Err(_) => return Err(Status::NoHttp),
        }
        let header = |name: &str| {
            let found = parsed.headers.iter().find(|header| header.name.eq_ignore_ascii_case(name));
            found.map_or(String::new(), |of| String::from_utf8_lossy(of.value).into_owned())
        };
        let url = parsed.path.unwrap_or_default();
        let (path, query) = url.split_once('?').unwrap_or((url, ""));
        Ok(Some(Request {
            is_get: parsed.method == Some("GET"),
            path: path.to_owned(),
            query: query.to_owned(),
            host: header("Host"),
            authorization: header("Authorization"),
        }))
    }

    /// As the request gives it; empty: it gives none.
    pub fn token(&self) -> &str {
        let scheme_and_token = self.authorization.split_once(' ');
        let bearer = scheme_and_token
            .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("Bearer"))
            .map(|(_, token)| token.trim());
        let of_query = self.query.split('&').find_map(|pair| pair.strip_prefix("token="));
        bearer.or(of_query).unwrap_or_default()
    }
}
