//! The model of long decays: one oscillator, the terms that are added to it, and lines and offsets.
//!
//! In: a [`Fit`], decays with terms and the numbers p (parameters). Out: what every series shows of the motion,
//! its derivatives by the numbers, and the waves that the lines add.
//!
//! In a burst, output j shows y_j = g_j x + h_j x'/omega + sum_w (a_w cos + b_w sin) e^{-sigma_w t} + offset,
//! where x(t) follows the equation of `motion.rs` from the burst's own start. Of the first output g = 1 and
//! h = 0; of the others these shares of displacement and velocity are fitted. What is shown at rest ([`AtRest`]) and
//! the amplitudes of waves are free in every series. They are linear, so they are no numbers here: `elimination.rs`
//! finds them. Derivatives of the motion are central differences.

use super::decays::Decays;
use super::motion::Motion;
use super::terms::{Line, Term};
use inkling_core::model::waves::waves;

/// Indices of the oscillator's own numbers: damping and undamped frequency (per sample), then x and
/// x'/omega of each burst's first sample, then the shares of displacement and velocity of every
/// output but the first. The rate of a drift follows, if there is one, then the numbers of the terms, in their order.
pub const SIGMA: usize = 0;
pub const OMEGA: usize = 1;
const STARTS: usize = 2;

fn shares(decays: &Decays) -> usize {
    STARTS + 2 * decays.bursts
}

pub fn plain_numbers(decays: &Decays) -> usize {
    shares(decays) + 2 * (decays.outputs - 1)
}

/// Index of x and x'/omega of a burst's first sample.
pub fn start_of(burst: usize) -> usize {
    STARTS + 2 * burst
}

/// What a series shows at rest, in amounts of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AtRest {
    Zero,
    Offset,
    /// An offset, and beside it an exponential, whose rate all series share: a zero that drifts, or settles. A slow one
    /// is nearly a straight line.
    Drift,
}

impl AtRest {
    /// Number of its amplitudes in every series.
    pub fn columns(self) -> usize {
        match self {
            AtRest::Zero => 0,
            AtRest::Offset => 1,
            AtRest::Drift => 2,
        }
    }
}

/// A damped cosine and sine of free amplitudes in every series.
pub struct Wave {
    pub sigma: f64,
    pub omega: f64,
    /// Numbers that its damping and its frequency depend on, with the derivatives of both.
    pub by: Vec<(usize, [f64; 2])>,
}

/// The waves of a term whose numbers begin at `at`.
pub fn waves_of(term: Term, at: usize, p: &[f64]) -> Vec<Wave> {
    let (sigma, omega) = (p[SIGMA], p[OMEGA]);
    match term {
        Term::Line(Line::Mode) => {
            let by = vec![(at, [1.0, 0.0]), (at + 1, [0.0, 1.0])];
            vec![Wave { sigma: p[at], omega: p[at + 1], by }]
        }
        Term::Line(Line::Tone) => {
            vec![Wave { sigma: 0.0, omega: p[at], by: vec![(at, [0.0, 1.0])] }]
        }
        Term::Line(Line::SideBands) => [1.0, -1.0]
            .map(|up| {
                let by = vec![(at, [1.0, 0.0]), (at + 1, [0.0, up]), (OMEGA, [0.0, 1.0])];
                Wave { sigma: p[at], omega: omega + up * p[at + 1], by }
            })
            .into(),
        Term::Line(Line::Harmonic(k)) => {
            let k = f64::from(k);
            let by = vec![(SIGMA, [k, 0.0]), (OMEGA, [0.0, k])];
            vec![Wave { sigma: k * sigma, omega: k * omega, by }]
        }
        _ => Vec::new(),
    }
}

/// A model of some decays: the oscillator with what it shows at rest and its terms, and their numbers. `fit.rs` finds
/// these.
#[derive(Clone, Debug)]
pub struct Fit<'a> {
    pub decays: &'a Decays,
    pub at_rest: AtRest,
    pub terms: Vec<Term>,
    pub p: Vec<f64>,
    /// Of each series the amplitudes of all columns.
    pub free: Vec<Vec<f64>>,
    pub cost: f64,
    /// How many samples of each series it is fitted to: all, but while it is followed from the first ones on.
    pub upto: usize,
}

/// For one series the derivatives of what it shows of the motion, by the index of the number.
pub type Slopes = Vec<(usize, Vec<f64>)>;

impl Fit<'_> {
    /// The index of a drift's rate.
    pub fn drift(&self) -> Option<usize> {
        (self.at_rest == AtRest::Drift).then_some(plain_numbers(self.decays))
    }

    /// Number of those numbers that are none of the terms'.
    pub fn own_numbers(&self) -> usize {
        plain_numbers(self.decays) + usize::from(self.drift().is_some())
    }

    /// Its terms, each with the index of its first number.
    pub fn placed(&self) -> impl Iterator<Item = (Term, usize)> {
        self.terms.iter().scan(self.own_numbers(), |next, term| {
            let at = *next;
            *next += term.numbers();
            Some((*term, at))
        })
    }

    pub fn motion(&self) -> Motion {
        let p = &self.p;
        let mut motion = Motion { sigma: p[SIGMA], omega: p[OMEGA], ..Motion::default() };
        for (term, at) in self.placed() {
            match term {
                Term::Stiffness(form) => (motion.form, motion.stiffness) = (form, p[at]),
                Term::Drag => motion.drag = p[at],
                Term::Friction => motion.stick = p[at],
                Term::Unnamed(rival) => {
                    motion.unnamed.set(rival, &p[at..at + term.numbers()]);
                }
                Term::Line(_) => {}
            }
        }
        motion
    }

    /// x and x'/omega in the first samples of a burst.
    pub fn path(&self, burst: usize, samples: usize) -> Vec<[f64; 2]> {
        let at = start_of(burst);
        self.motion().run([self.p[at], self.p[at + 1]], samples)
    }

    pub fn waves(&self) -> Vec<Wave> {
        self.placed().flat_map(|(term, at)| waves_of(term, at, &self.p)).collect()
    }

    /// What the free amplitudes are those of: 1 for the offset, the drift, and the cosine and sine of each wave.
    pub fn columns(&self) -> Vec<Vec<f64>> {
        let mut columns = vec![vec![1.0; self.upto]; self.at_rest.columns().min(1)];
        columns.extend(self.drift().map(|at| {
            let [falls, _] = waves(self.p[at], 0.0, self.upto);
            falls
        }));
        let of_wave = |wave: Wave| waves(wave.sigma, wave.omega, self.upto);
        columns.extend(self.waves().into_iter().flat_map(of_wave));
        columns
    }

    /// The motion of a burst (`path`: x and x'/omega) as one output shows it.
    fn seen(&self, path: &[[f64; 2]], output: usize) -> Vec<f64> {
        let [x, u] = match output {
            0 => [1.0, 0.0],
            _ => [self.p[self.share(output)], self.p[self.share(output) + 1]],
        };
        path.iter().map(|[dx, du]| x * dx + u * du).collect()
    }

    fn share(&self, output: usize) -> usize {
        shares(self.decays) + 2 * (output - 1)
    }

    /// What each series shows of the motion, by burst, then output.
    pub fn moved(&self) -> Vec<Vec<f64>> {
        let of_burst = |burst: usize| {
            let path = self.path(burst, self.upto);
            (0..self.decays.outputs).map(move |o| self.seen(&path, o))
        };
        (0..self.decays.bursts).flat_map(of_burst).collect()
    }

    /// The numbers that the motion itself depends on, but for its starts, each with the step of its
    /// central difference, which changes the phase of a long decay by little.
    fn differences(&self) -> Vec<(usize, f64)> {
        let omega = self.p[OMEGA].abs();
        let rates = [(SIGMA, 1e-6 * omega), (OMEGA, 1e-7 * omega)];
        let of_terms = self.placed().flat_map(|(term, at)| {
            let numbers = 0..term.numbers();
            numbers.filter_map(move |j| Some((at + j, term.step(j, self.decays.samples)?)))
        });
        rates.into_iter().chain(of_terms).collect()
    }

    /// Derivatives of what the outputs of a burst show of the motion. A number on which a series does not
    /// depend is not there.
    pub fn slopes(&self, burst: usize) -> Vec<Slopes> {
        let own = [0, 1].map(|j| (start_of(burst) + j, 1e-6));
        let outputs = self.decays.outputs;
        let mut slopes: Vec<Slopes> = vec![Vec::new(); outputs];
        for (j, h) in self.differences().into_iter().chain(own) {
            let [mut slope, down] = [h, -h].map(|by| {
                let mut moved = self.clone();
                moved.p[j] += by;
                moved.path(burst, self.upto)
            });
            for ([x, u], [down_x, down_u]) in slope.iter_mut().zip(&down) {
                *x = (*x - down_x) * 0.5 / h;
                *u = (*u - down_u) * 0.5 / h;
            }
            (0..outputs).for_each(|o| slopes[o].push((j, self.seen(&slope, o))));
        }
        if outputs > 1 {
            let path = self.path(burst, self.upto);
            for (o, of) in slopes.iter_mut().enumerate().skip(1) {
                let share = |j: usize| (self.share(o) + j, path.iter().map(|at| at[j]).collect());
                of.extend([share(0), share(1)]);
            }
        }
        slopes
    }
}
