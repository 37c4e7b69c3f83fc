//! Somebody who is connected, and has so long and no longer: who sends or reads a byte at a time holds nothing for long.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// To read what was sent in vain, so that the answer is not lost with it.
const PARTING: Duration = Duration::from_secs(1);
const MOST_UNREAD: u64 = 64 << 10;

pub struct Client {
    stream: TcpStream,
    until: Instant,
}

impl Client {
    pub fn new(stream: TcpStream) -> Client {
        Client { stream, until: Instant::now() }
    }

    /// From here on reads and writes fail once `time` has passed, however many they are.
    pub fn give(&mut self, time: Duration) {
        self.until = Instant::now() + time;
    }

    fn left(&self) -> io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }

    /// The answer is whole.
    pub fn part(mut self) {
        self.give(PARTING);
        if self.stream.shutdown(Shutdown::Write).is_ok() {
            // whatever comes now, nobody is waiting for it
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
