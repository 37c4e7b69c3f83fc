//! A connection with a deadline for all reads and writes together, so that a client that sends or reads one
//! byte at a time cannot hold it for long.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// Time, and below it number of bytes, for reading what the client still sends. If it were left unread, the
/// system could reset the connection, and the answer would be lost.
const PARTING: Duration = Duration::from_secs(1);
const MOST_UNREAD: u64 = 64 << 10;

/// A client, and the time at which its reads and writes fail.
pub struct Client {
    stream: TcpStream,
    until: Instant,
}

impl Client {
    pub fn new(stream: TcpStream) -> Client {
        Client { stream, until: Instant::now() }
    }

    /// Sets the deadline: once `time` has passed, reads and writes fail, however many there were.
    pub fn give(&mut self, time: Duration) {
        self.until = Instant::now() + time;
    }

    /// The time until the deadline; an error once it has passed.
    fn left(&self) -> io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }

    /// Closes the connection after a complete answer.
    pub fn part(mut self) {
        self.give(PARTING);
        if self.stream.shutdown(Shutdown::Write).is_ok() {
            // the result does not matter, as the answer has been sent
            let _ = io::copy(&mut (&mut self).take(MOST_UNREAD), &mut io::sink());
        }
    }
}

impl Read for Client {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(into)
    }
}

impl Write for Client {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(from)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
