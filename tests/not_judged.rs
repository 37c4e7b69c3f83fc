//! A report never says that nothing needs care of what nobody judged: what was not judged stands first, on the page, on
//! the terminal and in its JSON.

use crate::house::House;
use crate::nights::{record, replay, some};
use inkling::burst::{Burst, Format};
use serde_json::Value;

/// What a report says of `of`.
struct Told {
    page: String,
    terminal: String,
    json: Value,
}

fn report(house: &House, of: &str, exit: i32) -> Told {
    let args = format!("report {of} -o r.html");
    let terminal = house.run(&args).exits(exit).stdout();
    let json = house.run(&format!("{args} --json")).exits(exit).stdout();
    Told {
        page: String::from_utf8(house.read("r.html")).unwrap(),
        terminal,
        json: serde_json::from_str(&json).unwrap(),
    }
}

impl Told {
    /// The first sentence says what was not judged, and nothing says that all is well.
    #[track_caller]
    fn leads_with(&self, words: &str) {
        let first = self.page.split("class=\"sentence\">").nth(1).unwrap();
        let first = first.split("</p>").next().unwrap();
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
        let lights = self.page.split("<p class=\"heads\">").nth(1).unwrap();
        let lights = lights.split("</p>").next().unwrap();
        let mut lights = lights.split("<span>").filter(|light| light.contains(printhead));
        let light = lights.next().unwrap_or_else(|| panic!("no light of {printhead}"));
        light.split("aria-label=\"").nth(1).unwrap().split('"').next().unwrap().to_owned()
    }
}

/// The same bursts as if a logger had sampled them every 5 us: no design fits.
fn unjudged(from: usize, n: usize) -> Vec<Burst> {
    some(from, n).into_iter().map(|b| Burst { sample_period_s: 5e-6, ..b }).collect()
}

/// The same a day later.
fn the_next_night(bursts: Vec<Burst>) -> Vec<Burst> {
    let day_ns = 86_400_000_000_000;
    bursts.into_iter().map(|b| Burst { t_acq_ns: b.t_acq_ns + day_ns, ..b }).collect()
}

/// The first `channels` of a burst at the converter's rail.
fn saturated(burst: Burst, channels: usize) -> Burst {
    assert_eq!(burst.format, Format::S16Le);
    let mut bytes = burst.samples.to_vec();
    let of_them = 2 * channels * burst.samples_per_channel as usize;
    bytes[..of_them].chunks_mut(2).for_each(|s| s.copy_from_slice(&i16::MAX.to_le_bytes()));
    Burst { samples: bytes.into(), ..burst }
}

#[test]
fn only_where_all_was_judged_does_a_report_say_that_nothing_needs_care() {
    let house = House::new();
    record(&house, "rec/a.mcap", &some(0, 6));
    replay(&house, "rec").exits(0);
    let told = report(&house, "out", 0);
    assert!(told.page.contains("none needs care.") && told.terminal.contains("nothing to clean"));
    assert_eq!(told.json["coverage"]["complete"], true, "{}", told.json);
    assert_eq!(told.light_of("cyan-1"), "healthy");

    // a single signal that was not
    let mut few = the_next_night(some(0, 6));
    few[2] = saturated(few[2].clone(), 1);
    record(&house, "rec/b.mcap", &few);
    replay(&house, "rec").exits(3);
    report(&house, "out", 0).leads_with("Not all is known: 1 signal (");
}

#[test]
fn empty_recordings_and_those_of_rejected_rows_stand_first() {
    let house = House::new();
    record(&house, "rec/a.mcap", &some(0, 6));
    record(&house, "rec/empty.mcap", &[]);
    replay(&house, "rec").exits(3);
    report(&house, "out", 0).leads_with("Not judged. empty.mcap: ");

    let house = House::new();
    let all = some(0, 6).into_iter().map(|b| {
        let channels = b.channels as usize;
        saturated(b, channels)
    });
    record(&house, "rec/b.mcap", &all.collect::<Vec<_>>());
    replay(&house, "rec").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Nothing was judged. b: none of the");
    assert_eq!(told.light_of("cyan-1"), "not judged");
    record(&house, "rec/c.mcap", &the_next_night(some(0, 6)));
    replay(&house, "rec --strict").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. b: none of the");
    assert_eq!(told.json["coverage"]["gaps"][0]["recording"], "b", "{}", told.json);
}

#[test]
fn of_half_of_the_printheads_nothing_is_known() {
    let house = House::new();
    let mut all = Vec::new();
    for (k, name) in ["k-1", "k-2", "k-3", "k-4"].into_iter().enumerate() {
        let bursts = if k < 2 { some(0, 6) } else { unjudged(0, 6) };
        all.extend(bursts.into_iter().map(|b| Burst { printhead: name.into(), ..b }));
    }
    record(&house, "night.mcap", &all);
    replay(&house, "night.mcap").exits(4);
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
    record(&house, "rec/a.mcap", &some(0, 6));
    record(&house, "rec/b.mcap", &the_next_night(unjudged(0, 6)));
    replay(&house, "rec").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. b: none of the");
    assert_eq!(told.light_of("cyan-1"), "not judged");
    let changed = told.page.split("<h2>What changed since the night before</h2>").nth(1).unwrap();
    let changed = changed.split("</ul>").next().unwrap();
    assert!(changed.contains("<b>Not judged last night:</b> cyan-1"), "{changed}");
}

#[test]
fn what_was_found_and_lost_is_not_called_healthy() {
    let house = House::new();
    record(&house, "rec/a.mcap", &some(0, 6));
    record(&house, "rec/b.mcap", &the_next_night(some(0, 6)));
    replay(&house, "rec").exits(0);
    std::fs::remove_file(house.path("out/a.episodes.parquet")).unwrap();
    let told = report(&house, "out", 3);
    told.leads_with("Not judged. out/a.episodes.parquet: is missing");
    assert!(told.terminal.contains("the faults of 1 recording are not known"), "{}", told.terminal);
    assert_eq!(told.light_of("cyan-1"), "not judged");
}

#[test]
fn other_recordings_of_the_same_times_are_no_copies_and_of_copies_the_judged_one_counts() {
    let house = House::new();
    record(&house, "rec/a.mcap", &unjudged(0, 6));
    record(&house, "rec/b.mcap", &some(0, 6));
    replay(&house, "rec").exits(4);
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. a: none of the");
    assert!(!told.page.contains("there already"), "another sampling is another recording");

    // the same recording twice: first by rails that nothing stays within, then as it should be
    let design = crate::pipeline::sample("design.json");
    let judge = format!("replay rec/b.mcap --design {}", design.display());
    house.run(&format!("{judge} --out first --set input.rails=[-1,1]")).exits(4);
    house.run(&format!("{judge} --out second")).exits(0);
    let told = report(&house, "first second", 0);
    assert!(told.page.contains("none needs care."), "{}", told.terminal);
    let left = "first/b.verdicts.parquet: verdicts of a recording that is there already (second/b";
    assert!(told.page.contains(left) && told.terminal.contains(left), "{}", told.terminal);
}
