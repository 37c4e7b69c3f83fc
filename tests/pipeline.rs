//! Verdicts do not depend on threads, file order, chunking, compression, layout or burst shape; a
//! fault that grows slowly is not learned as healthy; bad bursts are rows.

use crate::house::House;
use crate::recorded::{
    AS_RECORDED, Acquired, SAMPLE_MAJOR_FLOATS, bursts, counts, sample, slower, table_rows,
    with_samples, with_signals, write,
};
use inkling::burst::{Burst, Layout};
use inkling::episodes::Episode;
use inkling::io::recording_writer::{Compression, WriterOptions};
use serde_json::Value;
use std::sync::OnceLock;

/// A design that was trained where the ink's temperature varies: by it the sample's heads stand still.
fn design_that_knows_temperature(house: &House) -> &'static str {
    static TRAINED: OnceLock<Vec<u8>> = OnceLock::new();
    let design = TRAINED.get_or_init(|| {
        let house = House::new();
        let recordings = "sample_logs/train.mcap sample_logs/print_run.mcap";
        house.ok(&format!("train {recordings} --labels sample_logs/labels.csv -o knows.json"));
        house.read("knows.json")
    });
    house.write("knows.json", design);
    "knows.json"
}

#[test]
fn same_bytes_for_1_2_and_4_threads() {
    let house = House::new();
    let bytes = |threads: u32| {
        let args = format!("sample_logs/print_run.mcap --identify windows --threads {threads}");
        house.replay_to(&threads.to_string(), &args).exits(0);
        ["verdicts", "episodes"]
            .map(|kind| house.read(&format!("{threads}/print_run.{kind}.parquet")))
    };
    let one = bytes(1);
    assert!(one == bytes(2) && one == bytes(4), "bytes differ between threads");
}

/// What is said of each signal, however many rows it has.
fn sorted_rows(house: &House, of: &str) -> Vec<(Acquired, String)> {
    let rows = table_rows(&house.path(&format!("{of}.verdicts.parquet")));
    let mut said: Vec<_> = rows.into_iter().map(|(of, said, _)| (of, said)).collect();
    said.sort();
    said
}

struct Judged {
    rows: Vec<(Acquired, String)>,
    episodes: Vec<Episode>,
    /// What the summary counts of episodes.
    counts: Value,
}

/// Judges bursts that are written so by the design that knows temperature.
fn judged(bursts: &[Burst], written: WriterOptions, args: &str, exit: i32) -> Judged {
    let house = House::new();
    write(&house.path("r.mcap"), bursts, written);
    let design = design_that_knows_temperature(&house);
    house.run(&format!("replay r.mcap --design {design} --out out {args}")).exits(exit);
    let mut episodes = house.episodes("out/r");
    episodes.sort_by_key(|of| (of.printhead.clone(), of.channel, of.began_at_ns));
    let counts = house.read_json("out/r.summary.json")["episodes"].clone();
    Judged { rows: sorted_rows(&house, "out/r"), episodes, counts }
}

#[test]
fn verdicts_and_episodes_do_not_depend_on_how_the_recording_was_written() {
    const WINDOWS: &str = "--identify windows";
    let original = bursts(&sample("print_run.mcap"));
    let usual = WriterOptions::default();
    let reference = judged(&original, usual, WINDOWS, 0);
    assert_eq!(reference.rows.len(), 8640);
    assert!(reference.episodes.len() >= 8, "{:?}", reference.episodes);
    assert_eq!(reference.counts["episodes"], reference.episodes.len());

    let mut backward = original.clone();
    backward.reverse();
    let turned = original.iter().map(sample_major_floats).collect();
    let single = original.iter().flat_map(|burst| divided(burst, 1)).collect();
    let twice: Vec<Burst> = original.iter().flat_map(|b| [b.clone(), b.clone()]).collect();
    let options = |compression, chunk_bytes| WriterOptions { compression, chunk_bytes };
    let forms: [(&str, &Vec<Burst>, WriterOptions); 3] = [
        ("reversed, unchunked", &backward, options(Compression::None, None)),
        ("sample-major floats, small chunks", &turned, options(Compression::Zstd, Some(20_000))),
        ("single-channel bursts", &single, options(Compression::Lz4, Some(1 << 20))),
    ];
    for (form, bursts, written) in forms {
        let Judged { rows, episodes, .. } = judged(bursts, written, WINDOWS, 0);
        assert!(rows == reference.rows, "{form}: other verdicts");
        assert_eq!(episodes, reference.episodes, "{form}");
    }
    // repeated signals make another window; the design's models are the same
    let episodes = |bursts: &[Burst]| judged(bursts, usual, "--identify design", 0).episodes;
    assert_eq!(episodes(&twice), episodes(&original));
    // beyond the window in which they are put in order, signals are counted instead
    let reorder = "--set episodes.reorder_signals=1";
    let counts = judged(&backward, usual, reorder, 4).counts;
    assert!(counts["signals_too_late"].as_u64().unwrap() > 1000, "{counts}");
}

fn sample_major_floats(burst: &Burst) -> Burst {
    with_signals(burst, &counts(burst), SAMPLE_MAJOR_FLOATS)
}

/// Bursts of at most so many channels each, with one covariate value for all of a burst or one for each channel.
fn divided(burst: &Burst, most: u32) -> Vec<Burst> {
    let (firsts, counts) = ((0..burst.channels).step_by(most as usize), counts(burst));
    firsts
        .map(|first| {
            let rows = first as usize..(first + most).min(burst.channels) as usize;
            let of_rows = |covariate: &bytes::Bytes| match covariate.len() {
                0 | 1 => covariate.clone(),
                _ => covariate.slice(rows.clone()),
            };
            Burst {
                first_channel: burst.first_channel + first,
                idle_time_s: rows.clone().flat_map(|row| burst.idle_time_s(row)).collect(),
                neighbours_fired: of_rows(&burst.neighbours_fired),
                ..with_signals(burst, &counts[rows.clone()], AS_RECORDED)
            }
        })
        .collect()
}

/// Bursts of whose channels some ring with a damping that grows over the run.
fn drying(original: &[Burst], dries: impl Fn(u32) -> bool) -> Vec<Burst> {
    let first = original.iter().map(|b| b.t_acq_ns).min().unwrap();
    let last = original.iter().map(|b| b.t_acq_ns).max().unwrap();
    original
        .iter()
        .map(|burst| {
            let share = (burst.t_acq_ns - first) as f64 / (last - first) as f64;
            let extra_per_s = 1.2e4 * share; // 40 % of the healthy damping at the end
            with_samples(burst, |row, k, y| match dries(burst.first_channel + row as u32) {
                true => y * (-extra_per_s * k as f64 * burst.sample_period_s).exp(),
                false => y,
            })
        })
        .collect()
}

/// Windows of ten seconds, one right after the other.
const SHORT_WINDOWS: &str = "--identify windows --set identify.first=10 --set identify.every=10";

/// Share of flagged signals of those that were judged in the last ten seconds, of some channels.
fn late_share(house: &House, stem: &str, of: impl Fn(u32) -> bool) -> f64 {
    let rows = house.verdicts(&format!("out/{stem}"));
    let end = rows.keys().map(|k| k.0).max().unwrap();
    let late: Vec<&String> = rows
        .iter()
        .filter(|(k, v)| k.0 > end - 10_000_000_000 && of(k.2) && !v.starts_with("Rejected"))
        .map(|(_, v)| v)
        .collect();
    late.iter().filter(|v| !v.starts_with("Healthy")).count() as f64 / late.len() as f64
}

#[test]
fn fault_that_grows_slowly_is_not_learned_as_healthy() {
    let house = House::new();
    let original = bursts(&sample("print_run.mcap"));
    let dries = |channel: u32| channel.is_multiple_of(3);
    house.record("some.mcap", &drying(&original, dries));
    let replay = |args: &str| house.replay(&format!("{args} --force {SHORT_WINDOWS}"));
    replay("some.mcap");
    let (dry, others) =
        (late_share(&house, "some", dries), late_share(&house, "some", |c| !dries(c)));
    // a third that dries widens the windows' own spread; had the drying been learned, hardly any would be
    assert!(dry > 0.5 && others < 0.1, "{dry} of drying channels flagged, {others} of others");

    // all of them: windows are refused, and it is the head's
    house.record("all.mcap", &drying(&original, |_| true));
    let ended = replay("all.mcap").exits(4).says("max_damping_drift").says("moved together");
    let summary = house.read_json("out/all.summary.json");
    // of a head that moved its refused windows are not told, too
    for of in summary["warnings"].as_array().unwrap() {
        if of["what"].as_str().unwrap().contains("moved together") {
            let window = format!("window of {} at", of["printhead"].as_str().unwrap());
            assert!(!ended.stderr().contains(&window), "{}", ended.stderr());
        }
    }
    assert!(!summary["refused_windows"].as_array().unwrap().is_empty());
    let followed = late_share(&house, "all", |_| true);
    replay("all.mcap --set identify.common_change=false").exits(4).says("from the reference model");
    let alone = late_share(&house, "all", |_| true);
    assert!(followed < 0.1 && alone > 0.5, "{followed} flagged as a head, {alone} by themselves");
}

#[test]
fn a_refused_window_is_a_warning_with_its_own_word() {
    let house = House::new();
    let original = bursts(&sample("print_run.mcap"));
    let first = original.iter().map(|b| b.t_acq_ns).min().unwrap();
    // the window at the beginning is healthy, all channels have dried when the later ones come
    let dried = drying(&original, |_| true);
    let late = |b: &Burst| b.t_acq_ns > first + 30_000_000_000;
    let either = original.iter().zip(dried);
    let mixed: Vec<Burst> =
        either.map(|(b, dried)| if late(b) { dried } else { b.clone() }).collect();
    house.record("warm_up.mcap", &mixed);
    let alone = "--set identify.common_change=false";
    let ended = house.replay(&format!("warm_up.mcap {SHORT_WINDOWS} {alone}"));
    let refused = house.read_json("out/warm_up.summary.json")["refused_windows"].clone();
    assert!(!refused.as_array().unwrap().is_empty());
    let run = house.read_json("out/run.json");
    assert_eq!(run["recordings"][0]["outcome"], "window_refused");
    assert_eq!(
        (&run["totals"]["window_refused"], &run["totals"]["damaged"]),
        (&1.into(), &0.into())
    );
    let ended = ended.exits(0).says("warning: ");
    assert!(!ended.stdout().contains("damaged"), "{}", ended.stdout());
}

#[test]
fn a_head_that_stands_still_is_judged_bit_by_bit_as_without_its_common_change() {
    let house = House::new();
    let design = design_that_knows_temperature(&house);
    let judged = |out: &str, more: &str| {
        let replay = "replay sample_logs/print_run.mcap";
        house.ok(&format!("{replay} --design {design} --out {out} {more}"));
        house.verdicts(&format!("{out}/print_run"))
    };
    let alone = "--set identify.common_change=false";
    assert!(judged("one", "") == judged("other", alone), "verdicts differ");
    // where it cannot take effect, who asks for it is told, and who does not is not
    let command =
        "replay sample_logs/print_run.mcap --out third --set detect.method=residual-energy";
    let asked = format!("{command} --set identify.common_change=true");
    house
        .run(&asked)
        .exits(2)
        .says("identify.common_change")
        .says("detect.method = \"residual-energy\"");
    house.ok(command);
}

#[test]
fn bad_bursts_and_bad_signals_are_rows_with_their_reason() {
    let house = House::new();
    let mut all = bursts(&sample("print_run.mcap"));
    let n = all[0].samples_per_channel as usize;
    let floats = sample_major_floats(&all[0]);
    let mut nan = floats.samples.to_vec();
    nan[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    all[0] = Burst { samples: nan.into(), ..floats }; // first sample of channel 0
    let mut railed = all[1].samples.to_vec();
    for k in 0..2 {
        let at = match all[1].layout {
            Layout::ChannelMajor => 2 * (n + k),
            Layout::SampleMajor => 2 * (k * all[1].channels as usize + 1),
        };
        railed[at..at + 2].copy_from_slice(&i16::MAX.to_le_bytes());
    }
    all[1].samples = railed.into();
    all[2].sample_period_s = f64::NAN;
    let short = all[3].samples.len() - 2;
    all[3].samples = all[3].samples.slice(..short);
    all[4].sample_period_s *= 1.01;
    house.record("bad.mcap", &all);
    house.replay("bad.mcap --identify windows").exits(3).says("rejected");
    let counts = house.read_json("out/bad.summary.json")["counts"].take();
    for (reason, signals) in [
        ("non_finite", 1),
        ("saturated", 1),
        ("bad_period", 1),
        ("wrong_length", 1),
        ("design_mismatch", all[4].channels),
    ] {
        assert_eq!(counts["rejected"][reason], signals, "{reason}: {counts}");
    }
    assert_eq!((&counts["bursts"], &counts["unusable_bursts"]), (&all.len().into(), &2.into()));
}

#[test]
fn unknown_printhead_is_judged_by_the_pooled_model_if_it_agrees() {
    let house = House::new();
    let renamed = |b: &Burst| Burst { printhead: "stranger".into(), ..b.clone() };
    let strangers: Vec<Burst> = crate::nights::some(0, 60).iter().map(renamed).collect();
    house.record("agrees.mcap", &strangers);
    house.replay("agrees.mcap").exits(0);
    let summary = house.read_json("out/agrees.summary.json");
    assert_eq!(summary["counts"]["judged"], summary["counts"]["signals"]);

    house.record("differs.mcap", &strangers.iter().map(slower).collect::<Vec<_>>());
    house.replay("differs.mcap").exits(4).says("design_mismatch");
}

#[test]
fn without_a_design_faults_are_detected_and_not_named() {
    let house = House::new();
    house.ok("replay sample_logs/print_run.mcap --out out");
    let summary = house.read_json("out/print_run.summary.json");
    let faulty = summary["counts"]["faulty"].as_object().unwrap();
    assert_eq!(faulty.keys().collect::<Vec<_>>(), ["undecided"], "{faulty:?}");
}

#[test]
fn priors_move_what_is_named_and_unknown_names_are_refused() {
    let house = House::new();
    let replay = |more: &str| house.replay(&format!("sample_logs/print_run.mcap --force {more}"));
    let named = |more: &str| -> u64 {
        replay(more).exits(0);
        let counts = &house.read_json("out/print_run.summary.json")["counts"]["faulty"];
        counts["IDN"].as_u64().unwrap_or(0)
    };
    assert!(named("--set isolate.priors.IDN=1000") > named(""));
    replay("--set isolate.priors.XYZ=2").exits(2).says("isolate.priors names \"XYZ\"");
}

/// With a state kept: all channels of a moment in one message, one message each, in any order.
#[test]
fn how_a_moment_is_split_into_messages_changes_no_verdict_and_no_state() {
    let house = House::new();
    let original = bursts(&sample("print_run.mcap"));
    let divided = |most| original.iter().flat_map(move |burst| divided(burst, most)).collect();
    let single: Vec<Burst> = divided(1);
    let mut backward = single.clone();
    backward.chunk_by_mut(|a, b| a.t_acq_ns == b.t_acq_ns).for_each(<[Burst]>::reverse);
    let divisions = [
        ("whole", original.clone()),
        ("eights", divided(8)),
        ("single", single),
        ("back", backward),
    ];
    for (name, bursts) in &divisions {
        house.record(&format!("{name}.mcap"), bursts);
    }
    for mode in ["", "--identify windows", "--baseline NAME.json"] {
        let judged = divisions.each_ref().map(|(name, _)| {
            let mode = mode.replace("NAME", name);
            house.replay(&format!("{name}.mcap --force {mode}")).exits(0);
            let rows = house.verdicts(&format!("out/{name}"));
            let state = mode.ends_with("json").then(|| house.read(&format!("{name}.json")));
            (rows, state)
        });
        let [whole, others @ ..] = judged;
        assert!(whole.0.len() > 8000);
        for (other, (name, _)) in others.iter().zip(&divisions[1..]) {
            assert!(whole == *other, "{name} with {mode:?}");
        }
    }
}

/// The first eight channels are in every other moment alone, and then twice: both times the level of their own
/// moment judges, whichever message of it comes first.
#[test]
fn a_message_that_is_repeated_is_judged_as_it_was_the_first_time() {
    let house = House::new();
    let original = bursts(&sample("print_run.mcap"));
    let rows_of = |name: &str, last_first: bool| {
        let mut written = Vec::new();
        for (i, burst) in original.iter().enumerate() {
            let mut moment = divided(burst, 8);
            match i % 2 {
                0 => drop(moment.remove(0)),
                _ => moment.insert(1, moment[0].clone()),
            }
            if last_first {
                moment.rotate_left(2);
            }
            written.extend(moment);
        }
        house.record(&format!("{name}.mcap"), &written);
        house.replay(&format!("{name}.mcap")).exits(0);
        sorted_rows(&house, &format!("out/{name}"))
    };
    let (first, last) = (rows_of("first", false), rows_of("last", true));
    assert!(first.len() > 8000 && first == last);
}

/// What all channels do is the head's, with a state, too: the next day all are smaller, and none is faulty for it.
#[test]
fn a_head_that_is_driven_otherwise_the_next_day_has_no_faults_by_its_state() {
    let house = House::new();
    let healthy = bursts(&sample("print_run.mcap"));
    let smaller = |burst: &Burst| with_samples(burst, |_, _, y| 0.9 * y);
    let later = crate::nights::days_later(healthy.iter().map(smaller).collect(), 1);
    let faulty = |name: &str, bursts: &[Burst]| {
        house.record(&format!("{name}.mcap"), bursts);
        house.replay(&format!("{name}.mcap --baseline own.json"));
        let verdicts = house.verdicts(&format!("out/{name}"));
        verdicts.values().filter(|said| !said.starts_with("Healthy")).count()
    };
    let (first, next) = (faulty("first", &healthy), faulty("next", &later));
    // 318 signals of the sample are faulty; what is faulty stays so
    assert!((300..450).contains(&first), "{first}");
    assert!((300..450).contains(&next), "{next}");
}

/// Without a design the identify stage reads ahead while its first window is open; a paced recording is handed
/// over burst by burst meanwhile.
#[test]
fn a_pace_is_kept_burst_by_burst_once_and_changes_no_verdict() {
    let house = House::new();
    for (named, design) in [("by_design", "--design sample_logs/design.json"), ("without", "")] {
        let judged = |out: &str, pace: &str| {
            let out = format!("{named}/{out}");
            let replay = format!("replay sample_logs/print_run.mcap {design} --out {out} {pace}");
            let told = house.ok(&replay);
            let summary = house.read_json(&format!("{out}/print_run.summary.json"));
            (house.verdicts(&format!("{out}/print_run")), summary, told)
        };
        let (verdicts, free, _) = judged("max", "");
        let (paced_verdicts, paced, told) = judged("paced", "--pace 100000");
        assert!(verdicts == paced_verdicts, "{named}");
        assert!(told.contains("at the pace that was asked for"), "{told}");
        let (free, rates) = (&free["rates"], &paced["rates"]);
        assert_eq!(rates["paced_bursts"], paced["counts"]["bursts"], "{named}: {rates}");
        assert!(rates["behind_s"].as_f64().is_some(), "{named}: {rates}");
        assert!(free["paced_bursts"].is_null() && free["behind_s"].is_null(), "{named}: {free}");
    }
}
