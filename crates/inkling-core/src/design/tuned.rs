//! All numbers of the room `design` that nobody derived. `docs/design/numbers.md` tells what half
//! and twice of each do.

/// Fewest signals of a window for which the spread of the channels and the thresholds are
/// learned from the window; with fewer, those of the model before (the anchor) are used.
pub const FEWEST_OWN: usize = 200;
/// If the threshold learned from labelled signals exceeds the one by the mixture model by more
/// than this factor, some of the signals are probably faulty.
pub const SUSPECT: f64 = 3.0;
/// Where the channels of a printhead lie more than this many times as far from each other as
/// the design says, its threshold does not judge a channel of which nothing else is known.
pub const AGED: f64 = 1.5;
/// -2 ln of how much less probable a signal of a channel whose level is off has to be by the channel's
/// fault than by its healthy level, so that the fault is over for it: as one signal in 30,000 of a fault at four
/// standard deviations would be by chance.
pub const OVER: f64 = 16.0;
/// How far from the model's temperature, K, its linear effect is asked: heads hold their ink within a few K, and at 25
/// K an exponential law with 2 % a K lies 11 % off its tangent.
pub const REACH_K: f64 = 25.0;
/// From where on a recorded temperature is not that of the ink: so many K, and so many standard deviations, from the one
/// at which the burst's rings lie. A kelvin does about half of what channels differ by.
pub const WRONG_K: f64 = 1.0;
pub const WRONG_SD: f64 = 6.0;
/// Robust standard deviations of a printhead's channels beyond which one that is labelled healthy is told: of a
/// thousand Gaussian channels the farthest lies at three.
pub const ODD_CHANNEL: f64 = 8.0;
/// A common change of the amplitude beyond this, relative, is warned about: a supply sags by less.
pub const GAIN_BOUND: f64 = 0.25;
/// Share of the labelled bursts at either end whose size says nothing of the gain: a few without a drop are no other.
pub const STRAY_BURSTS: f64 = 0.05;
/// Standard deviations of a sudden change that all channels have in common: of ln amplitude; of
/// ln damping and of ln frequency, in units of ln (1 + their bound in `[identify]`); and of the
/// phase, rad. A change beyond five of these is no ink.
pub const LEAP: [f64; 4] = [0.1, 1.0, 0.4, 0.05];
