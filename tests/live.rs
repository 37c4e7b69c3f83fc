//! A recording that is being followed is served: a page, events, metrics and faults by plain HTTP; on this machine, or
//! with a token.
#![cfg(unix)]

use crate::follow::{Follower, Growing, create, in_order};
use crate::house::{HANGS, House};
use crate::prometheus::families;
use inkling::io::recording_writer::Compression;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Instant;

/// What a server answers: its head, and its body.
pub struct Answer {
    pub head: String,
    pub body: String,
}

pub fn connected(address: &str, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(HANGS)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    stream
}

pub fn asked(address: &str, request: &str) -> Answer {
    let mut text = String::new();
    connected(address, request).read_to_string(&mut text).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{request}: {text}"));
    Answer { head: head.to_owned(), body: body.to_owned() }
}

pub fn request(path: &str, more: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n{more}\r\n")
}

#[track_caller]
pub fn got(address: &str, path: &str) -> Answer {
    let answer = asked(address, &request(path, ""));
    assert!(answer.head.starts_with("HTTP/1.1 200 "), "{path}: {}", answer.head);
    answer
}

pub fn serving(follower: &mut Follower) -> String {
    follower.next("serving")["address"].as_str().unwrap().to_owned()
}

/// States as a page hears them.
struct Events(BufReader<TcpStream>);

impl Events {
    fn of(address: &str) -> Events {
        Events(BufReader::new(connected(address, &request("/events", ""))))
    }

    fn next(&mut self) -> Option<Value> {
        let mut line = String::new();
        loop {
            line.clear();
            if self.0.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            if let Some(state) = line.strip_prefix("data: ") {
                return Some(serde_json::from_str(state).unwrap());
            }
        }
    }
}

fn channels(of: &Value) -> BTreeSet<(String, u64)> {
    let one = |fault: &Value| {
        (fault["printhead"].as_str().unwrap().to_owned(), fault["channel"].as_u64().unwrap())
    };
    of["faults"].as_array().unwrap().iter().map(one).collect()
}

fn metric(metrics: &str, name: &str) -> f64 {
    let lines = metrics.lines().filter(|line| !line.starts_with('#'));
    let values = lines
        .filter(|line| line.split(['{', ' ']).next() == Some(name))
        .map(|line| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap());
    values.sum()
}

#[test]
fn what_is_followed_is_served_as_it_is_told_and_taken_up_again() {
    const ARGS: &str = "--identify design --serve 127.0.0.1:0";
    let mut growing = Growing::of(&in_order(), Compression::Zstd, Some(30_000), ARGS);
    let address = serving(&mut growing.follower);
    let page = got(&address, "/");
    assert!(page.head.contains("default-src 'none'"), "{}", page.head);
    assert!(!page.body.contains("http") && page.body.contains("src=\"page.js\""), "{}", page.body);
    assert!(got(&address, "/page.js").body.contains("EventSource"));
    assert_eq!(metric(&got(&address, "/metrics").body, "inkling_signals_total"), 0.0);

    let mut events = Events::of(&address);
    assert_eq!(events.next().unwrap()["recording"], "now.mcap");
    growing.write_to(2.0 / 3.0);
    let (since, mut state) = (Instant::now(), Value::Null);
    while state["faults"].as_array().is_none_or(|faults| faults.len() < 3) {
        assert!(since.elapsed() < HANGS, "{state}");
        state = events.next().expect("events go on");
    }
    drop(events);
    // every fault that is shown is one that was told
    let of = |fault: &Value| {
        let text = |key: &str| fault[key].as_str().unwrap_or_default().to_owned();
        (text("printhead"), fault["channel"].as_u64(), text("raised_at"))
    };
    let mut untold: BTreeSet<_> = state["faults"].as_array().unwrap().iter().map(of).collect();
    while !untold.is_empty() {
        untold.remove(&of(&growing.follower.next("episode")));
    }
    let told = state["faults"][0].clone();

    // who comes again hears all of it at once
    let state = Events::of(&address).next().unwrap();
    assert!(!channels(&state).is_empty() && state["signals"].as_u64() > Some(0), "{state}");
    let heads = state["heads"].as_array().unwrap();
    let map = heads.iter().find(|head| head["printhead"] == told["printhead"]).unwrap();
    assert_eq!(map["channels"].as_str().unwrap().len(), 48, "{map}");
    let faults: Value = serde_json::from_str(&got(&address, "/faults.json").body).unwrap();
    assert!(!channels(&faults).is_empty(), "{faults}");
    let metrics = got(&address, "/metrics").body;
    assert!(metric(&metrics, "inkling_open_faults") > 0.0, "{metrics}");
    assert!(metrics.contains("category=\""), "{metrics}");
    assert!(families(&metrics).contains_key("inkling_known_faults"), "{metrics}");

    let mut events = Events::of(&address);
    growing.write_to(1.0);
    let mut last = Value::Null;
    while let Some(state) = events.next() {
        last = state;
    }
    assert_eq!(last["ended"], true, "{last}");
    growing.follower.ends(0);
    // what is on at the end is what the table leaves open
    let table = growing.house.episodes("out/now");
    let open = table.iter().filter(|episode| episode.ended_at_ns.is_none());
    let open = open.map(|episode| (episode.printhead.to_string(), u64::from(episode.channel)));
    assert_eq!(channels(&last), open.collect(), "{last}");
    assert_eq!(last["signals"], 8_640, "{last}");
    growing.is_as_replayed("--identify design");
}

#[test]
fn nobody_looks_who_may_not() {
    let house = House::new();
    create(&house);
    house.write("secret", "0123456789abcdef-secret\n");
    let mut follower =
        Follower::start(&house, "--identify design --serve 0.0.0.0:0 --serve-token secret");
    let address = serving(&mut follower).replace("0.0.0.0", "127.0.0.1");
    for path in ["/metrics", "/faults.json", "/events", "/metrics?token=0123456789abcdef"] {
        let answer = asked(&address, &request(path, ""));
        assert!(answer.head.starts_with("HTTP/1.1 401 "), "{path}: {}", answer.head);
    }
    got(&address, "/");
    got(&address, "/metrics?token=0123456789abcdef-secret");
    let bearer = "Authorization: Bearer 0123456789abcdef-secret\r\n";
    let answer = asked(&address, &request("/faults.json", bearer));
    assert!(answer.head.starts_with("HTTP/1.1 200 ") && answer.body.contains("\"faults\":[]"));
    drop(follower);

    // this machine is served by its name, too
    let mut follower = Follower::start(&house, "--identify design --serve localhost:0");
    let address = serving(&mut follower);
    assert!(address.parse::<std::net::SocketAddr>().unwrap().ip().is_loopback(), "{address}");
    got(&address, "/");
    let elsewhere = request("/metrics", "").replace("Host: 127.0.0.1", "Host: evil.example");
    let posted = request("/metrics", "").replace("GET", "POST");
    for (request, status) in [(elsewhere, 403), (posted, 405), (request("/../etc/passwd", ""), 404)]
    {
        let answer = asked(&address, &request);
        assert!(answer.head.starts_with(&format!("HTTP/1.1 {status} ")), "{}", answer.head);
    }
}

#[test]
fn a_port_that_is_taken_is_said_before_anything_is_done() {
    let house = House::new();
    create(&house);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let args = format!("replay now.mcap --follow --serve {address} --out out");
    house.run(&args).exits(1).says(&format!("--serve {address}: cannot listen"));
    // neither a lock nor a journal is left behind
    assert!(!house.path("out").exists());
}
