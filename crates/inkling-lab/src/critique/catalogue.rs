//! The catalogue of causes: one row for each, with all that this room knows of a cause by its name; and the
//! rivals without a name that compete with them. There is no algorithm here.
//!
//! The other files read a row by [`CauseId::row`]: `candidates` and `decay` decide by `acts` and `in_decays`
//! how a cause is tested, `selection` by `free` what it costs. Names,
//! parameters and units are the contract's (`schemas/critique.md`): changing them breaks readers of files.

use super::covariates::{Covariates, IDLE, NEIGHBOURS, POSITION, TEMPERATURE, TIME};
use super::held_out::FEWEST_UNITS;
use super::observations::Observations;
use super::tuned::{LAGS, PLACES, SETTLES};
use inkling_core::model::free_decay::Theta;
use serde::Serialize;
use std::fmt;

/// Identifies a cause by its row in [`CATALOGUE`] and then in [`RIVALS`]: the order is that of the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CauseId {
    Offset,
    Droop,
    Meniscus,
    Lowpass,
    SecondMode,
    QuadraticDrag,
    DryFriction,
    CubicStiffness,
    FractionalDamping,
    Tone,
    RandomTone,
    TriggerJitter,
    Clipping,
    CoarseLsb,
    PreviousTail,
    Crosstalk,
    Temperature,
    Ageing,
    PositionGradient,
    ClockDrift,
    CorrelatedNoise,
    HeteroscedasticNoise,
    // rivals, without a name
    EvenSpring,
    OneSidedSpring,
    SpringWithGap,
    LossFollowsTime,
    FrequencyFollowsTime,
    EvenSensor,
    OddSensor,
    GainFollowsAmplitude,
    DeafSensor,
    GainSways,
    TimeBaseSways,
    OwnShape,
}

#[derive(Clone, Copy, Debug)]
pub struct Entry {
    pub id: CauseId,
    /// Name in files and texts; empty for a rival, like the next two.
    pub name: &'static str,
    /// Name of the parameter that tells the cause's size, and its unit (`1`: none).
    pub parameter: &'static str,
    pub unit: &'static str,
    pub needs: Needs,
    /// What is wrong; the parameter and its value follow these words.
    pub words: &'static str,
    /// The term that it adds to y = s C e^{A t} x_a + e, or changes in it.
    pub equation: &'static str,
    pub acts: Acts,
    /// Number of free parameters beside the coefficients of its shapes; each costs 2 where refitted models
    /// are compared.
    pub free: f64,
    /// Values of its second number (place of a stop, lag, rate of settling) that are tried, or, in decays,
    /// from which its search begins; a single 0 if it has none.
    pub seconds: &'static [f64],
    /// The experiment that tells it from what it may be tied with.
    pub split_by: Experiment,
    /// Whether it can be found in a single oscillator's long decays.
    pub in_decays: InDecays,
}

/// What the data must hold for a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    Nothing,
    DriveScan,
    Temperature,
    Idle,
    Neighbours,
    Time,
    Channels,
    Codes,
    SharedBursts,
}

/// What a cause acts through.
#[derive(Clone, Copy, Debug)]
pub enum Acts {
    /// It adds a shape in time to the mean signal.
    Mean(Shape),
    /// A covariate moves damping, frequency or all rates of a signal.
    Rates { covariate: usize, moves: Theta, per: Per },
    /// A covariate adds a share of the ring to the signal, at any phase.
    Ring { covariate: usize },
    /// A later part of the previous ring is added to the signal.
    PreviousRing,
    /// It changes the noise of single signals.
    Noise,
    /// It shifts all signals of a burst in time.
    Trigger,
    /// The converter changes samples.
    Codes,
}

#[derive(Clone, Copy, Debug)]
pub enum Shape {
    Constant,
    /// The integral of the ring, with a leak.
    Droop,
    /// The slow mode of a meniscus that is pulled back.
    SlowMode,
    /// An exponential that begins with the acquisition.
    Transient,
    /// An undamped line that does not scale with the drive.
    Tone,
    Mode,
    Motion(Motion),
    /// What a sensor's curve, or rates that follow time, make of the ring (`candidates/rivals.rs` has the
    /// equations). `power`: as of [`Motion`].
    Bent(i32),
    Sways,
    /// A bump or a step, wherever it fits best.
    Own,
}

#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Power of the drive that the added signal scales with where there is no drive scan. 1: the term is
    /// linear, so it does not act through the amplitude.
    pub power: i32,
    /// Strength at which its search begins, and the largest one.
    pub strengths: [f64; 2],
}

/// Change of theta per relative change of the damping (all losses), of the frequency (both stiffnesses), or of all
/// rates. The real pole follows the damping, since the last parameter is relative to it.
const DAMPING: Theta = Theta::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
const FREQUENCY: Theta = Theta::new(0.0, 1.0, 0.0, 0.0, 0.0, 0.0);
const ALL_RATES: Theta = Theta::new(1.0, 1.0, 0.0, 0.0, 0.0, 0.0);

#[derive(Clone, Copy, Debug)]
pub enum Per {
    /// Per unit of the covariate.
    Unit,
    /// From the smallest value of the recording to the largest, as a relative change.
    Span,
}

/// The experiment that would split a tie. Of those of two causes the first in this order is proposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Experiment {
    HeatTheInk,
    HalveTheDrive,
    StartLater,
    RecordMore,
}

/// What becomes of a cause in long decays.
#[derive(Clone, Copy, Debug)]
pub enum InDecays {
    /// It is fitted; with words of its own where the catalogue's do not suit a decay.
    Fitted(Option<&'static str>),
    Needs(&'static str),
}

/// The values that most rows share.
const MOST: Entry = Entry {
    id: CauseId::Offset,
    name: "",
    parameter: "",
    unit: "1",
    needs: Needs::Nothing,
    words: "",
    equation: "",
    acts: Acts::Noise,
    free: 0.0,
    seconds: &[0.0],
    split_by: Experiment::RecordMore,
    in_decays: InDecays::Fitted(None),
};

const fn motion(power: i32, strengths: [f64; 2]) -> Acts {
    Acts::Mean(Shape::Motion(Motion { power, strengths }))
}

const fn rates(covariate: usize, moves: Theta, per: Per) -> Acts {
    Acts::Rates { covariate, moves, per }
}

const INK_CHANNEL: InDecays = InDecays::Needs("the ink channel's equations");
const MANY_BURSTS: InDecays = InDecays::Needs("many bursts");
const SEVERAL_TIMES: InDecays = InDecays::Needs("many bursts at several times");
const WHOLE_COUNTS: InDecays = InDecays::Needs("many bursts of whole counts");

/// To add a cause, add: its identifier and its row, here; its test, in the file of what it acts through
/// (`candidates/shapes.rs`, `lines.rs` or `follows.rs`, `ensemble`, `jitter`, `codes`); if it acts in a way
/// of its own, the arm of that way in `candidates/mod.rs`, or the term in `unmodelled.rs`; a signal that has
/// it in `generator.rs`, for the tests; and a line of `docs/design/critique.md`. Long decays (`decay/`)
/// need nothing if the row's `in_decays` says what these lack.
#[rustfmt::skip]
pub static CATALOGUE: [Entry; 22] = [
    Entry { id: CauseId::Offset, name: "offset", parameter: "offset", unit: "counts",
        words: "the sensor has an offset that does not scale with the drive",
        equation: "+ b",
        acts: Acts::Mean(Shape::Constant), split_by: Experiment::HalveTheDrive,
        in_decays: InDecays::Fitted(Some("the sensor has an offset: what it shows at rest is not zero")), ..MOST },
    Entry { id: CauseId::Droop, name: "droop", parameter: "rate", unit: "1/s", needs: Needs::DriveScan,
        words: "the charge amplifier droops (a high-pass that is reset at t_a)",
        equation: "- w int_0^t e^{-w(t-u)} y(u) du", acts: Acts::Mean(Shape::Droop),
        in_decays: INK_CHANNEL, ..MOST },
    Entry { id: CauseId::Meniscus, name: "meniscus", parameter: "compliance_ratio", needs: Needs::DriveScan,
        words: "surface tension in the nozzle pulls the meniscus back",
        equation: "; q_n' gains -(B_t/B_m) V_n/(I_n B_t)",
        acts: Acts::Mean(Shape::SlowMode), free: 1.0, in_decays: INK_CHANNEL, ..MOST },
    Entry { id: CauseId::Lowpass, name: "lowpass", parameter: "rate", unit: "1/s",
        words: "the sensor amplifier's low-pass has a transient in the first samples",
        equation: "+ y(0) h e^{-w t}",
        acts: Acts::Mean(Shape::Transient), free: 1.0, split_by: Experiment::StartLater,
        in_decays: INK_CHANNEL, ..MOST },
    Entry { id: CauseId::SecondMode, name: "second_mode", parameter: "frequency", unit: "Hz", needs: Needs::DriveScan,
        words: "a second mode rings along",
        equation: "+ s e^{-gamma t} (p cos 2 pi f2 t + q sin 2 pi f2 t)", acts: Acts::Mean(Shape::Mode), free: 2.0, ..MOST },
    Entry { id: CauseId::QuadraticDrag, name: "quadratic_drag", parameter: "damping_change", needs: Needs::DriveScan,
        words: "damping grows with amplitude: quadratic drag at the nozzle",
        equation: "; q_n' gains -k |q_n| q_n", acts: motion(2, [0.01, 3.0]),
        in_decays: InDecays::Fitted(Some("damping grows with amplitude: drag that grows with speed squared")), ..MOST },
    Entry { id: CauseId::DryFriction, name: "dry_friction", parameter: "damping_change", needs: Needs::DriveScan,
        words: "damping grows as the amplitude falls: dry friction",
        equation: "; q_n' gains -mu sign(q_n)", acts: motion(0, [0.01, 3.0]), ..MOST },
    Entry { id: CauseId::CubicStiffness, name: "cubic_stiffness", parameter: "frequency_change", needs: Needs::DriveScan,
        words: "the frequency changes with amplitude: the stiffness is not linear",
        equation: "; V becomes V + k3 V^3", acts: motion(3, [0.002, 0.4]), ..MOST },
    Entry { id: CauseId::FractionalDamping, name: "fractional_damping", parameter: "eta",
        words: "part of the loss is a boundary layer's (half-order damping)",
        equation: "; (1 - eta) R_n q_n + eta R_n omega^{-1/2} D^{1/2} q_n",
        acts: motion(1, [0.02, 1.0]),
        in_decays: INK_CHANNEL, ..MOST },
    Entry { id: CauseId::Tone, name: "tone", parameter: "frequency", unit: "Hz",
        words: "an interference of fixed phase is added",
        equation: "+ p cos 2 pi f t + q sin 2 pi f t", acts: Acts::Mean(Shape::Tone), free: 1.0,
        in_decays: InDecays::Fitted(Some("an undamped line is added: an interference from outside")), ..MOST },
    Entry { id: CauseId::RandomTone, name: "random_tone", parameter: "frequency", unit: "Hz",
        words: "an interference whose phase differs from burst to burst is added",
        equation: "+ p cos(2 pi f t + phase of the burst)", acts: Acts::Noise, in_decays: MANY_BURSTS, ..MOST },
    Entry { id: CauseId::TriggerJitter, name: "trigger_jitter", parameter: "sd", unit: "s", needs: Needs::SharedBursts,
        words: "the trigger jitters: t_a of a burst's channels shifts from burst to burst",
        equation: "; x_a becomes e^{A delta} x_a, delta one for all channels of a burst", acts: Acts::Trigger,
        in_decays: InDecays::Needs("many bursts of several channels each"), ..MOST },
    Entry { id: CauseId::Clipping, name: "clipping", parameter: "level", unit: "counts", needs: Needs::Codes,
        words: "large samples are clipped",
        equation: "; y becomes min(y, L)", acts: Acts::Codes, in_decays: WHOLE_COUNTS, ..MOST },
    Entry { id: CauseId::CoarseLsb, name: "coarse_lsb", parameter: "step", unit: "counts", needs: Needs::Codes,
        words: "the converter misses codes: its resolution is coarse",
        equation: "; y becomes q round(y/q)", acts: Acts::Codes, in_decays: WHOLE_COUNTS, ..MOST },
    Entry { id: CauseId::PreviousTail, name: "previous_tail", parameter: "gain", needs: Needs::Idle,
        words: "the ring of the previous actuation has not died away at t_a",
        equation: "+ g s f(t + idle time)", acts: Acts::PreviousRing,
        in_decays: InDecays::Needs("idle_time_s, recorded in many bursts"), ..MOST },
    Entry { id: CauseId::Crosstalk, name: "crosstalk", parameter: "kappa", needs: Needs::Neighbours,
        words: "channels that fire beside it are heard",
        equation: "+ kappa n_nb s f(t, at another phase)", acts: Acts::Ring { covariate: NEIGHBOURS },
        in_decays: InDecays::Needs("neighbours_fired, recorded in many bursts"), ..MOST },
    Entry { id: CauseId::Temperature, name: "temperature", parameter: "damping_change", unit: "1/K", needs: Needs::Temperature,
        words: "damping follows the ink's temperature",
        equation: "; R becomes R (1 + beta (T - mean T))",
        acts: rates(TEMPERATURE, DAMPING, Per::Unit), split_by: Experiment::HeatTheInk,
        in_decays: InDecays::Needs("temperature_c, recorded in many bursts"), ..MOST },
    Entry { id: CauseId::Ageing, name: "ageing", parameter: "damping_change", needs: Needs::Time,
        words: "damping drifts over the recording",
        equation: "; R becomes R (1 + a t/run)",
        acts: rates(TIME, DAMPING, Per::Span), split_by: Experiment::HeatTheInk,
        in_decays: SEVERAL_TIMES, ..MOST },
    Entry { id: CauseId::PositionGradient, name: "position_gradient", parameter: "frequency_change", needs: Needs::Channels,
        words: "the resonance changes along the printhead",
        equation: "; 1/B_t changes along the channels", acts: rates(POSITION, FREQUENCY, Per::Span),
        in_decays: InDecays::Needs("six channels or more, one oscillator each"), ..MOST },
    Entry { id: CauseId::ClockDrift, name: "clock_drift", parameter: "rate_change", needs: Needs::Time,
        words: "all rates drift together: the sampling clock drifts",
        equation: "; t becomes t (1 + eps t/run)",
        acts: rates(TIME, ALL_RATES, Per::Span), split_by: Experiment::HeatTheInk,
        in_decays: SEVERAL_TIMES, ..MOST },
    Entry { id: CauseId::CorrelatedNoise, name: "correlated_noise", parameter: "rho",
        words: "the noise of neighbouring samples is correlated",
        equation: "; e_k = rho e_{k-1} + white", acts: Acts::Noise,
        in_decays: InDecays::Needs("many bursts: a single decay's misfit may be either"), ..MOST },
    Entry { id: CauseId::HeteroscedasticNoise, name: "heteroscedastic_noise", parameter: "h",
        words: "the noise grows with the signal",
        equation: "; var e = v (1 + h f^2/max f^2)", acts: Acts::Noise, in_decays: MANY_BURSTS, ..MOST },
];

/// A rival: no file holds its identifier, and readers see its words alone.
const fn rival(id: CauseId, words: &'static str, shape: Shape) -> Entry {
    Entry { id, words, acts: Acts::Mean(shape), ..MOST }
}

/// What is not in the catalogue, and would wrongly get the name of a cause that resembles it. Where a rival
/// is clearly likelier, the misfit gets no name, and the reader is told what the misfit is like.
#[rustfmt::skip]
pub static RIVALS: [Entry; 12] = [
    rival(CauseId::EvenSpring, "a spring of even order",
        Shape::Motion(Motion { power: 2, strengths: [0.01, 1.0] })),
    Entry { free: 1.0, seconds: &PLACES, ..rival(CauseId::OneSidedSpring, "a spring that is stiffer on one side",
        Shape::Motion(Motion { power: 1, strengths: [0.01, 1.0] })) },
    rival(CauseId::SpringWithGap, "a spring with a gap",
        Shape::Motion(Motion { power: 0, strengths: [0.002, 0.5] })),
    rival(CauseId::LossFollowsTime, "a damping that changes with time", Shape::Bent(1)),
    Entry { free: 1.0, seconds: &SETTLES, ..rival(CauseId::FrequencyFollowsTime, "a frequency that changes with time",
        Shape::Bent(1)) },
    rival(CauseId::EvenSensor, "a sensor curve of even order", Shape::Bent(2)),
    rival(CauseId::OddSensor, "a sensor curve of odd order", Shape::Bent(3)),
    Entry { free: 1.0, seconds: &LAGS, ..rival(CauseId::GainFollowsAmplitude, "a gain that follows the amplitude",
        Shape::Bent(2)) },
    rival(CauseId::DeafSensor, "a sensor that is deaf about its zero", Shape::Bent(0)),
    Entry { free: 1.0, ..rival(CauseId::GainSways, "a gain that sways", Shape::Sways) },
    Entry { free: 1.0, ..rival(CauseId::TimeBaseSways, "a time base that sways", Shape::Sways) },
    rival(CauseId::OwnShape, "a shape of its own", Shape::Own),
];
/// The first so many rivals are tried in decays, too.
pub const IN_DECAYS: usize = 9;

impl CauseId {
    pub fn row(self) -> &'static Entry {
        CATALOGUE.get(self as usize).unwrap_or_else(|| &RIVALS[self as usize - CATALOGUE.len()])
    }

    pub fn has_name(self) -> bool {
        (self as usize) < CATALOGUE.len()
    }

    pub fn name(self) -> &'static str {
        self.row().name
    }

    pub fn follows(self) -> Option<usize> {
        match self.row().acts {
            Acts::Rates { covariate, .. } | Acts::Ring { covariate } => Some(covariate),
            Acts::PreviousRing => Some(IDLE),
            Acts::Mean(_) | Acts::Noise | Acts::Trigger | Acts::Codes => None,
        }
    }

    pub fn is_shape(self) -> bool {
        matches!(self.row().acts, Acts::Mean(_))
    }

    /// Whether its addition does not scale with the drive as the ring itself does.
    pub fn by_amplitude(self) -> bool {
        matches!(self.row().acts, Acts::Mean(Shape::Motion(Motion { power, .. })) if power != 1)
    }
}

impl fmt::Display for CauseId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl Needs {
    pub fn lacking(self, data: &Observations) -> Option<&'static str> {
        let Covariates { present, drive_scan, idle, shared_bursts, .. } = data.beside;
        let (there, what) = match self {
            Needs::Nothing => return None,
            Needs::DriveScan => {
                (drive_scan, "drive_voltage_v, recorded, with a standard deviation of 3 % or more")
            }
            Needs::Temperature => (present[TEMPERATURE], "temperature_c, recorded and varied"),
            Needs::Idle => (idle, "idle_time_s"),
            Needs::Neighbours => (present[NEIGHBOURS], "neighbours_fired, recorded and varied"),
            Needs::Time => (present[TIME], "bursts at several times"),
            Needs::Channels => {
                (present[POSITION] && data.units >= FEWEST_UNITS, "six channels or more")
            }
            Needs::Codes => (data.integer, "whole counts"),
            Needs::SharedBursts => (shared_bursts, "bursts of several channels each"),
        };
        (!there).then_some(what)
    }
}

pub fn experiment(p: CauseId, q: CauseId) -> &'static str {
    match p.row().split_by.min(q.row().split_by) {
        Experiment::HeatTheInk => {
            "heat the ink while the time runs on (or repeat the run at a constant temperature)"
        }
        Experiment::HalveTheDrive => {
            "repeat at half the drive voltage: an offset stays, what rings shrinks with it"
        }
        Experiment::StartLater => {
            "start the acquisition some microseconds later: a transient of the amplifier follows the \
             start, the boundary layer's loss does not"
        }
        Experiment::RecordMore => "record longer decays and a wider range of drive voltages",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_stands_where_its_identifier_says() {
        for (place, row) in CATALOGUE.iter().chain(&RIVALS).enumerate() {
            assert_eq!(row.id as usize, place, "{}", row.words);
        }
    }

    #[test]
    fn every_cause_has_a_row_and_a_name_of_its_own() {
        let last = CauseId::HeteroscedasticNoise as usize;
        assert_eq!(CATALOGUE.len(), last + 1);
        for (i, row) in CATALOGUE.iter().enumerate() {
            assert!(CATALOGUE[..i].iter().all(|other| other.name != row.name), "{}", row.name);
            for text in [row.name, row.parameter, row.unit, row.words, row.equation] {
                assert!(!text.is_empty(), "{}", row.name);
            }
            // a name in files is the identifier in small letters, with _ between its words
            let mut name = String::new();
            for c in format!("{:?}", row.id).chars() {
                name.extend((c.is_uppercase() && !name.is_empty()).then_some('_'));
                name.extend(c.to_lowercase());
            }
            assert_eq!(row.name, name);
            assert_eq!(serde_json::to_string(&row.id).unwrap(), format!("\"{name}\""));
        }
    }

    #[test]
    fn the_experiment_that_splits_a_tie_is_that_of_either() {
        use CauseId::*;
        let half = "repeat at half the drive voltage: an offset stays, what rings shrinks with it";
        assert_eq!(experiment(Droop, Offset), half);
        assert_eq!(experiment(Offset, Droop), half);
        assert!(experiment(Offset, Ageing).starts_with("heat the ink"));
        assert!(experiment(Droop, Meniscus).starts_with("record longer"));
        let amplitude: Vec<CauseId> =
            CATALOGUE.iter().map(|row| row.id).filter(|id| id.by_amplitude()).collect();
        assert_eq!(amplitude, [QuadraticDrag, DryFriction, CubicStiffness]);
    }
}
