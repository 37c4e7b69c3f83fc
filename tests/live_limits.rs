//! The live view where many are connected, send slowly, take slowly or send too much: so much is held and no more, and
//! others are answered.
#![cfg(target_os = "linux")]

use crate::follow::{Follower, create};
use crate::house::{HANGS, House, wait_until};
use crate::live::{asked, connected, request, serving};
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// As `src/cli/live/connections.rs` has it: connections, and a thread for each.
const MOST_CONNECTIONS: usize = 64;

/// A recording that has not begun, and where its live view is.
struct Served {
    follower: Follower,
    address: String,
    _house: House,
}

fn served() -> Served {
    let house = House::new();
    create(&house);
    let mut follower = Follower::start(&house, "--identify design --serve 127.0.0.1:0");
    Served { address: serving(&mut follower), follower, _house: house }
}

fn threads(follower: &Follower) -> usize {
    let status = std::fs::read_to_string(format!("/proc/{}/status", follower.pid())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("Threads:")).unwrap();
    line.trim().parse().unwrap()
}

/// Whoever finds no room may see the connection break before its answer.
fn is_answered(address: &str) -> bool {
    let mut text = String::new();
    let read = connected(address, &request("/metrics", "")).read_to_string(&mut text);
    read.is_ok() && text.starts_with("HTTP/1.1 200 ")
}

#[test]
fn three_hundred_who_say_nothing_hold_few_threads_and_not_for_long() {
    let Served { follower, address, .. } = &served();
    assert!(is_answered(address));
    let before = threads(follower);
    let mut most = before;
    let connect = |_| {
        let idle = connected(address, "");
        most = most.max(threads(follower));
        idle
    };
    let idle: Vec<_> = (0..300).map(connect).collect();
    assert!(most <= before + MOST_CONNECTIONS, "{most} threads, {before} before");
    // those who were let in are let go, though they never went away
    wait_until("others are answered again", || is_answered(address));
    drop(idle);
}

#[test]
fn who_sends_a_letter_at_a_time_is_let_go() {
    let Served { address, .. } = &served();
    let mut slow = connected(address, "GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ");
    slow.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let since = Instant::now();
    let mut piece = [0; 64];
    loop {
        assert!(since.elapsed() < HANGS, "still heard");
        match slow.write_all(b"x").and_then(|()| slow.read(&mut piece)) {
            // nothing yet
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            // the connection is closed, unanswered
            Ok(n) => break assert_eq!(n, 0),
            Err(_) => break,
        }
    }
}

#[test]
fn heads_that_are_too_large_or_none_are_refused() {
    let Served { address, .. } = &served();
    let long = request("/metrics", &format!("X: {}\r\n", "x".repeat(7_000)));
    assert!(asked(address, &long).head.starts_with("HTTP/1.1 200 "));
    let endless = format!("X: {}\r\n", "x".repeat(20_000));
    for (more, status) in [(endless, 431), ("no header\r\n".into(), 400)] {
        let answer = asked(address, &request("/metrics", &more));
        assert!(answer.head.starts_with(&format!("HTTP/1.1 {status} ")), "{}", answer.head);
    }
    let answer = asked(address, "\x16\x03\x01\x02 what speaks TLS");
    assert!(answer.head.starts_with("HTTP/1.1 400 "), "{}", answer.head);
}

#[test]
fn so_many_pages_are_open_and_no_more_and_others_are_answered() {
    let Served { address, .. } = &served();
    let open = || {
        let mut page = connected(address, &request("/events", ""));
        let mut status = [0; 12];
        page.read_exact(&mut status).unwrap();
        (page, String::from_utf8_lossy(&status).into_owned())
    };
    let pages: Vec<_> = (0..32).map(|_| open()).collect();
    assert!(pages.iter().all(|(_, status)| status == "HTTP/1.1 200"));
    assert_eq!(open().1, "HTTP/1.1 503");
    assert!(is_answered(address));
    // who closes a page makes room for another
    drop(pages);
    wait_until("pages that were closed make room", || open().1 == "HTTP/1.1 200");
}
