//! A report never says that nothing needs care of what nobody judged: what was not judged stands first, on the page, on
//! the terminal and in its JSON.

use crate::dialects::writers::{Messages, Written, json, write as write_foreign};
use crate::house::{House, between};
use crate::nights::{days_later, sampled_otherwise, some};
use crate::recorded::{rows, with_samples};
use crate::report::deadened;
use inkling::burst::Burst;
use inkling::io::burst_codec;
use serde_json::Value;

/// What a report says of `of`.
pub struct Told {
    pub page: String,
    pub terminal: String,
    json: Value,
}

pub fn report(house: &House, of: &str, exit: i32) -> Told {
    let args = format!("report {of} -o r.html");
    let terminal = house.run(&args).exits(exit).stdout();
    let json = house.run(&format!("{args} --json")).exits(exit).stdout();
    Told { page: house.text("r.html"), terminal, json: serde_json::from_str(&json).unwrap() }
}

impl Told {
    /// Of the page.
    pub fn first_sentence(&self) -> &str {
        between(&self.page, "class=\"sentence\">", "</p>")
    }

    /// The first sentence says what was not judged, and nothing says that all is well.
    #[track_caller]
    pub fn leads_with(&self, words: &str) {
        let first = self.first_sentence();
        assert!(first.starts_with(words), "{first}");
        assert!(self.terminal.starts_with(words), "{}", self.terminal);
        for calm in ["none needs care", "othing to clean", "<p>Nothing.</p>"] {
            assert!(!self.page.contains(calm) && !self.terminal.contains(calm), "{calm}: {first}");
        }
        assert_eq!(self.json["coverage"]["complete"], false, "{}", self.json);
    }

    /// The light beside a printhead's name.
    #[track_caller]
    fn light_of(&self, printhead: &str) -> String {
        let lights = between(&self.page, "<p class=\"heads\">", "</p>");
        let light = lights.split("<span>").find(|light| light.contains(printhead));
        let light = light.unwrap_or_else(|| panic!("no light of {printhead}"));
        between(light, "aria-label=\"", "\"").to_owned()
    }
}

/// What is told of recordings in a house, once they were judged with an exit status.
#[track_caller]
fn judged(house: &House, recordings: &[(&str, &[Burst])], exit: i32) -> Told {
    for (name, bursts) in recordings {
        house.record(&format!("rec/{name}.mcap"), bursts);
    }
    house.replay("rec").exits(exit);
    report(house, "out", 0)
}

fn the_next_night(bursts: Vec<Burst>) -> Vec<Burst> {
    days_later(bursts, 1)
}

fn called(bursts: Vec<Burst>, printhead: &str) -> Vec<Burst> {
    bursts.into_iter().map(|b| Burst { printhead: printhead.into(), ..b }).collect()
}

/// The first `channels` of a burst at the converter's rail.
fn saturated(burst: Burst, channels: usize) -> Burst {
    with_samples(&burst, |row, _, y| if row < channels { i16::MAX.into() } else { y })
}

#[test]
fn only_where_all_was_judged_does_a_report_say_that_nothing_needs_care() {
    let house = House::new();
    let told = judged(&house, &[("a", &some(0, 6))], 0);
    assert!(told.page.contains("none needs care.") && told.terminal.contains("nothing to clean"));
    assert_eq!(told.json["coverage"]["complete"], true, "{}", told.json);
    assert_eq!(told.light_of("cyan-1"), "healthy");

    // a single signal that was not
    let mut few = the_next_night(some(0, 6));
    few[2] = saturated(few[2].clone(), 1);
    judged(&house, &[("b", &few)], 3).leads_with("Not all is known: 1 signal (");
}

#[test]
fn empty_recordings_and_those_of_rejected_rows_stand_first() {
    let recordings: [(&str, &[Burst]); 2] = [("a", &some(0, 6)), ("empty", &[])];
    judged(&House::new(), &recordings, 3).leads_with("Not judged. empty.mcap: ");

    let house = House::new();
    let all: Vec<Burst> = some(0, 6).into_iter().map(|b| saturated(b, usize::MAX)).collect();
    let told = judged(&house, &[("b", &all)], 4);
    told.leads_with("Nothing was judged. b: none of the");
    assert_eq!(told.light_of("cyan-1"), "not judged");
    house.record("rec/c.mcap", &the_next_night(some(0, 6)));
    house.replay("rec --strict").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. b: none of the");
    assert_eq!(told.json["coverage"]["gaps"][0]["recording"], "b", "{}", told.json);
}

#[test]
fn of_half_of_the_printheads_nothing_is_known() {
    let house = House::new();
    let mut all = Vec::new();
    for (k, name) in ["k-1", "k-2", "k-3", "k-4"].into_iter().enumerate() {
        let bursts = if k < 2 { some(0, 6) } else { sampled_otherwise(0, 6) };
        all.extend(called(bursts, name));
    }
    house.record("night.mcap", &all);
    house.replay("night.mcap").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. night: none of the");
    assert!(told.page.contains("of k-3 could") && told.page.contains("of k-4 could"));
    assert_eq!(
        (told.light_of("k-1").as_str(), told.light_of("k-3").as_str()),
        ("healthy", "not judged")
    );
}

#[test]
fn a_night_that_no_design_fits_is_the_last_night_all_the_same() {
    let house = House::new();
    let next = the_next_night(sampled_otherwise(0, 6));
    let told = judged(&house, &[("a", &some(0, 6)), ("b", &next)], 4);
    told.leads_with("Not judged. b: none of the");
    assert_eq!(told.light_of("cyan-1"), "not judged");
    let changed = between(&told.page, "<h2>What changed since the night before</h2>", "</ul>");
    assert!(changed.contains("<b>Not judged last night:</b> cyan-1"), "{changed}");
}

#[test]
fn what_was_found_and_lost_is_not_called_healthy() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 6));
    house.record("rec/b.mcap", &the_next_night(some(0, 6)));
    house.replay("rec").exits(0);
    std::fs::remove_file(house.path("out/a.episodes.parquet")).unwrap();
    let told = report(&house, "out", 3);
    told.leads_with("Not judged. out/a.episodes.parquet: is missing");
    assert!(told.terminal.contains("the faults of 1 recording are not known"), "{}", told.terminal);
    assert_eq!(told.light_of("cyan-1"), "not judged");
    // and the other's are lost, too
    std::fs::remove_file(house.path("out/b.episodes.parquet")).unwrap();
    assert!(report(&house, "out", 3).page.contains("What needs care is not known"));
}

#[test]
fn other_recordings_of_the_same_times_are_no_copies_and_of_copies_the_judged_one_counts() {
    let house = House::new();
    let told = judged(&house, &[("a", &sampled_otherwise(0, 6)), ("b", &some(0, 6))], 4);
    told.leads_with("Not judged. a: none of the");
    assert!(!told.page.contains("there already"), "another sampling is another recording");

    // the same recording twice: first by rails that nothing stays within, then as it should be
    let judge = "replay rec/b.mcap --design sample_logs/design.json";
    house.run(&format!("{judge} --out first --set input.rails=[-1,1]")).exits(4);
    house.run(&format!("{judge} --out second")).exits(0);
    let told = report(&house, "first second", 0);
    assert!(told.page.contains("none needs care."), "{}", told.terminal);
    let left = "first/b.verdicts.parquet: verdicts of a recording that is there already (second/b";
    assert!(told.page.contains(left) && told.terminal.contains(left), "{}", told.terminal);
}

#[test]
fn heads_and_channels_that_fell_silent_are_told() {
    let half = |b: Burst| {
        let (channels, bytes) = (b.channels / 2, b.samples.len() / 2);
        Burst { channels, samples: b.samples.slice(..bytes), ..b }
    };
    let night: Vec<Burst> = the_next_night(some(0, 12)).into_iter().map(half).collect();
    let told = judged(&House::new(), &[("a", &some(0, 12)), ("b", &night)], 0);
    told.leads_with("Not judged. b: 24 of 48 channels of cyan-1 fell silent");

    let night = called(the_next_night(some(0, 12)), "cyan-2");
    judged(&House::new(), &[("a", &some(0, 12)), ("b", &night)], 0).leads_with(
        "Not judged. a: the last recording of cyan-1: it was not heard in the last night",
    );
}

/// As on a clock that is so many times as fast, by cubic interpolation (Catmull and Rom).
fn on_another_clock(burst: &Burst, times: f64) -> Burst {
    let rows = rows(burst);
    with_samples(burst, |row, k, _| {
        let y = &rows[row];
        let at = |k: i64| y[k.clamp(0, y.len() as i64 - 1) as usize];
        let (whole, u) = ((k as f64 * times) as i64, (k as f64 * times).fract());
        let [a, b, c, d] = [-1, 0, 1, 2].map(|offset| at(whole + offset));
        let slope = [c - a, d - b].map(|twice| twice / 2.0);
        let (square, cube) = (u * u, u * u * u);
        b * (2.0 * cube - 3.0 * square + 1.0)
            + slope[0] * (cube - 2.0 * square + u)
            + c * (3.0 * square - 2.0 * cube)
            + slope[1] * (cube - square)
    })
}

/// A clock that is 3 to 6 % off is no ink, and is not followed: it is another printhead than the design's of that name.
#[test]
fn a_head_that_is_elsewhere_as_a_whole_is_told() {
    for times in [1.0, 0.98, 0.97, 0.96, 0.94] {
        let house = House::new();
        let off = some(0, 40).iter().map(|b| on_another_clock(b, times)).collect();
        house.record("a.mcap", &called(off, "dataset"));
        let ended = house.replay("a.mcap --identify design");
        let told = ended.stdout() + &ended.stderr();
        // two percent are followed, and told; more is no longer this head
        let followed = told.contains("moved together");
        let rejected = told.contains("ring as this printhead never did");
        assert_eq!(followed || rejected, times < 1.0, "{times}: {told}");
        assert!(rejected || times >= 0.98, "{times}: {told}");
        assert_eq!(ended.code() == Some(0), !rejected, "{times}: {told}");
    }
}

#[test]
fn what_is_flagged_in_each_of_few_bursts_is_told() {
    let house = House::new();
    for night in 0..4 {
        let burst = deadened(&some(night, 1)[0], 9);
        house.record(&format!("rec/{night}.mcap"), &days_later(vec![burst], night as i64));
    }
    house.replay("rec").exits(0);
    report(&house, "out", 0).leads_with(
        "Not judged. 3: channel 9 of cyan-1: flagged in most signals, of which no recording",
    );
}

#[test]
fn frozen_channels_are_told_by_number_whatever_they_are_judged_by() {
    let bursts = some(0, 30);
    let first = rows(&bursts[0]);
    let frozen = |b: &Burst| with_samples(b, |row, k, y| if row == 5 { first[5][k] } else { y });
    for by in ["", "--baseline b.json", "--identify windows"] {
        let house = House::new();
        let bursts: Vec<Burst> = bursts.iter().map(frozen).collect();
        house.record("rec/a.mcap", &bursts);
        house.replay(&format!("rec {by}")).exits(3);
        let told = report(&house, "out", 0);
        told.leads_with("Not judged. a: channel 5 of cyan-1: mostly not judged");
        assert!(told.terminal.contains("the same samples"), "{}", told.terminal);
    }
}

/// One in five of 240 channels stands still, more than the others among the 48 that are looked at in a sweep.
#[test]
fn some_frozen_channels_of_many_leave_the_others_judged() {
    let (bursts, n) = (some(0, 30), 30);
    let part = |t: usize, j: usize| {
        let of = if j == 0 { &bursts[0] } else { &bursts[(t + 5 * j) % n] };
        let (t_acq_ns, first_channel) = (bursts[t].t_acq_ns, 48 * j as u32);
        Burst { t_acq_ns, first_channel, ..of.clone() }
    };
    let wide: Vec<Burst> =
        (0..n).flat_map(|t| (0..5).map(move |j| (t, j))).map(|(t, j)| part(t, j)).collect();
    let house = House::new();
    judged(&house, &[("a", &wide)], 3);
    let counts = &house.read_json("out/a.summary.json")["counts"];
    let judged = counts["judged"].as_u64().unwrap();
    assert!(judged >= 4 * 48 * n as u64, "{counts}");
}

#[test]
fn signals_of_one_time_are_followed_by_nobody() {
    let house = House::new();
    let at_once = |bursts: Vec<Burst>| -> Vec<Burst> {
        bursts.into_iter().map(|b| Burst { t_acq_ns: 0, ..b }).collect()
    };
    house.record("rec/a.mcap", &at_once(some(0, 6)));
    let told = "of cyan-1 have the time of another one of their channel (1970-01-01T00:00:00Z)";
    house.replay("rec --quiet").exits(4).says(told).says("a recorder whose clock stands?");
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. a: 240 of 288 signals of cyan-1");
    assert_eq!(told.light_of("cyan-1"), "not judged");
    // a burst that is written again is a look that is there already
    let thrice: Vec<Burst> =
        some(0, 6).into_iter().flat_map(|b| [b.clone(), b.clone(), b]).collect();
    let told = judged(&House::new(), &[("a", &thrice)], 0);
    assert!(told.page.contains("none needs care."));
}

#[test]
fn topics_that_nobody_reads_are_told() {
    let heads = || [some(0, 6), called(some(6, 6), "k-2")].concat();
    let dialect = |topic: &str| {
        format!(
            "[[input.dialect]]\ntopic = \"{topic}\"\nsamples = \"samples\"\nchannels = \"channels\"\n\
             period_s = \"period\"\nprinthead = \"{{topic.1}}\"\ntime = \"header.stamp\"\n"
        )
    };
    let house = House::new();
    let json = json();
    write_foreign(&house.path("night.mcap"), &heads(), &json);
    house.write("all.toml", dialect("/heads/*/burst"));
    house.write("one.toml", dialect("/heads/cyan-1/burst"));
    house.replay("night.mcap --config all.toml").exits(0);
    house
        .replay("night.mcap --config one.toml --force --quiet")
        .exits(4)
        .says("topic /heads/k-2/burst: its 6 messages")
        .says("nobody judged them");
    report(&house, "out", 0).leads_with("Not judged. night: topic /heads/k-2/burst");
    // who does not want them says so, and hears no more of them
    let ignore = "--set input.ignore=[\"/heads/k-*/burst\"]";
    house.replay(&format!("night.mcap --config one.toml {ignore}")).exits(0);
    assert!(report(&house, "out", 0).page.contains("none needs care."));
    // beside bursts of ours they may be anything that looks alike: a warning, also where one message is large
    for times in [1, 60] {
        let house = House::new();
        let mut both = Messages::default();
        let kept = heads();
        let wide = kept[6..].iter().map(|b| Burst {
            channels: times * b.channels,
            samples: b.samples.repeat(times as usize).into(),
            idle_time_s: Vec::new(),
            neighbours_fired: Default::default(),
            ..b.clone()
        });
        both.add_bursts(&json, &wide.collect::<Vec<_>>());
        for burst in some(0, 6) {
            let topic = burst_codec::topic(&burst.printhead);
            both.add(&native(), &topic, 1, &burst_codec::encode(&burst));
        }
        house.write("both.mcap", both.finish());
        house.replay("both.mcap").exits(0).says("look like bursts, and nothing reads them");
        report(&house, "out", 0).leads_with("Not judged. both: topic /heads/k-2/burst");
    }
}

/// As ours are written.
fn native() -> Written {
    Written {
        schema_name: burst_codec::SCHEMA_NAME,
        schema_encoding: burst_codec::MESSAGE_ENCODING,
        schema: burst_codec::FILE_DESCRIPTOR_SET.into(),
        message_encoding: burst_codec::MESSAGE_ENCODING,
        encode: burst_codec::encode,
    }
}

#[cfg(unix)]
#[test]
fn what_a_killed_run_was_to_judge_stands_first() {
    use crate::kills::{start, wait_for_a_part};
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 6));
    house.replay("rec").exits(0);
    house.record("rec/b.mcap", &the_next_night(some(0, 60)));
    house.record("rec/c.mcap", &the_next_night(some(0, 6)));
    let mut run = start(&house, "replay rec --pace recorded");
    wait_for_a_part(&house);
    report(&house, "out", 0).leads_with("Not judged. b.mcap: not judged yet by the run that began");
    run.kill().unwrap();
    run.wait().unwrap();
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. b.mcap: not judged yet by the run that began");
    assert!(told.page.contains("c.mcap: not judged yet"), "{}", told.terminal);
    house.replay("rec").exits(0).says("2 judged, 1 skipped");
    assert_eq!(report(&house, "out", 0).json["coverage"]["complete"], true);
}

#[test]
fn a_printhead_of_which_a_tenth_was_not_judged_is_not_called_healthy() {
    let light = |of_48: usize, in_every: usize| {
        let bursts = some(0, 6).into_iter().enumerate().map(|(k, b)| match k % in_every {
            0 => saturated(b, of_48),
            _ => b,
        });
        let told = judged(&House::new(), &[("a", &bursts.collect::<Vec<_>>())], 3);
        told.leads_with("Not ");
        told.light_of("cyan-1")
    };
    assert_eq!(light(1, 6), "healthy", "a single signal");
    assert_eq!(light(2, 3), "healthy", "two channels in a third of their bursts");
    assert_eq!(light(10, 1), "not judged", "a fifth of the channels");
    assert_eq!(light(2, 1), "not judged", "two channels");
    assert_eq!(light(20, 3), "not judged", "a seventh of all signals");
}

#[test]
fn a_sample_period_that_is_off_by_a_thousand_is_no_verdict() {
    let house = House::new();
    let slow = some(0, 6).into_iter().map(|b| Burst { sample_period_s: 1e-3, ..b });
    house.record("rec/a.mcap", &slow.collect::<Vec<_>>());
    house.run("replay rec --out out --quiet").exits(4).says("printheads ring at kilohertz");
    assert_eq!(house.read_json("out/run.json")["totals"]["not_judged"], 1);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. a: cyan-1: ");
    assert_eq!(told.light_of("cyan-1"), "not judged");
}
