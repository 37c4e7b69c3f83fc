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

/// What cannot be answered as it was asked.
pub enum Refused {
    NoHttp,
    TooLarge,
}

impl Request {
    /// # Errors
    /// The client is slow, or has gone.
    pub fn read(client: &mut Client) -> io::Result<Result<Request, Refused>> {
        let mut head = Vec::new();
        let mut piece = [0; 1024];
        loop {
            let n = client.read(&mut piece)?;
            if n == 0 {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            head.extend_from_slice(&piece[..n]);
            match Request::parse(&head) {
                Ok(None) if head.len() >= MOST_BYTES => return Ok(Err(Refused::TooLarge)),
                Ok(None) => {}
                Ok(Some(request)) => return Ok(Ok(request)),
                Err(refused) => return Ok(Err(refused)),
            }
        }
    }

    /// None: more is to come.
    fn parse(head: &[u8]) -> Result<Option<Request>, Refused> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        match parsed.parse(head) {
            Ok(status) if status.is_partial() => return Ok(None),
            Ok(_) => {}
            Err(httparse::Error::TooManyHeaders) => return Err(Refused::TooLarge),
            Err(_) => return Err(Refused::NoHttp),
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
