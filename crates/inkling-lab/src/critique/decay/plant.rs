//! The model of long decays: one oscillator, and the terms that are added to it.
//!
//! In: decays, terms, and the numbers p (parameters). Out: every sample that the model predicts,
//! and its derivatives by the numbers.
//!
//! In a burst, output j shows y_j = g_j x + h_j x'/omega + offset_j + lines, where x(t) follows the
//! equation of `motion.rs` from the burst's own start. Of the first output g = 1 and h = 0; of the
//! others these shares of displacement and velocity are fitted. Series are ordered by burst, then
//! output. Derivatives of the motion are central differences; those of shares, offsets and lines
//! are exact.

use super::decays::Decays;
use super::motion::Motion;
use super::terms::{Line, Term};
use crate::critique::waves::waves;
use std::collections::BTreeMap;

/// Indices of the oscillator's own numbers: damping and undamped frequency (per sample), then x and
/// x'/omega of each burst's first sample, then the shares of displacement and velocity of every
/// output but the first. The numbers of the terms follow, in the terms' order.
pub const SIGMA: usize = 0;
pub const OMEGA: usize = 1;
const STARTS: usize = 2;

fn shares(decays: &Decays) -> usize {
    STARTS + 2 * decays.bursts
}

pub fn plain_numbers(decays: &Decays) -> usize {
    shares(decays) + 2 * (decays.outputs - 1)
}

pub fn placed(decays: &Decays, terms: &[Term]) -> impl Iterator<Item = (Term, usize)> {
    terms.iter().scan(plain_numbers(decays), |next, term| {
        let at = *next;
        *next += term.numbers(decays);
        Some((*term, at))
    })
}

pub fn motion(decays: &Decays, terms: &[Term], p: &[f64]) -> Motion {
    let mut motion = Motion { sigma: p[SIGMA], omega: p[OMEGA], ..Motion::default() };
    for (term, at) in placed(decays, terms) {
        match term {
            Term::Stiffness(form) => (motion.form, motion.stiffness) = (form, p[at]),
            Term::Drag => motion.drag = p[at],
            Term::Friction => motion.stick = p[at],
            Term::Unnamed(rival) => {
                motion.unnamed.set(rival, &p[at..at + term.numbers(decays)]);
            }
            Term::Offset | Term::Line(_) => {}
        }
    }
    motion
}

pub fn path(motion: &Motion, p: &[f64], burst: usize, samples: usize, out: &mut Vec<[f64; 2]>) {
    let at = STARTS + 2 * burst;
    motion.run([p[at], p[at + 1]], samples, out);
}

/// For each series the derivatives of its samples, by the index of the number; sparse.
pub struct Jacobian {
    upto: usize,
    pub series: Vec<BTreeMap<usize, Vec<f64>>>,
}

impl Jacobian {
    /// The column of a number in the series whose samples begin at `at`; a new column is zero.
    fn of(&mut self, at: usize, number: usize) -> &mut [f64] {
        let columns = &mut self.series[at / self.upto];
        columns.entry(number).or_insert_with(|| vec![0.0; self.upto])
    }
}

/// The oscillator with some terms, in the first `upto` samples of some decays.
pub struct Plant<'a> {
    pub decays: &'a Decays,
    terms: &'a [Term],
    pub upto: usize,
}

impl<'a> Plant<'a> {
    pub fn new(decays: &'a Decays, terms: &'a [Term], upto: usize) -> Plant<'a> {
        Plant { decays, terms, upto: upto.min(decays.samples) }
    }

    pub fn len(&self) -> usize {
        self.decays.bursts * self.decays.outputs * self.upto
    }

    /// Burst and output of every series, and the index at which its samples begin.
    fn series(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        let (outputs, upto) = (self.decays.outputs, self.upto);
        (0..self.decays.bursts * outputs).map(move |i| (i / outputs, i % outputs, i * upto))
    }

    pub fn measured(&self) -> Vec<f64> {
        let of = |(burst, output, _)| &self.decays.series(burst, output)[..self.upto];
        self.series().flat_map(of).copied().collect()
    }

    /// The motion of a burst (`path`: x and x'/omega) as one output shows it.
    fn seen<'p>(
        &self,
        p: &[f64],
        path: &'p [[f64; 2]],
        output: usize,
    ) -> impl Iterator<Item = f64> + 'p {
        let (x, u) = match output {
            0 => (1.0, 0.0),
            _ => (p[self.share(output)], p[self.share(output) + 1]),
        };
        path.iter().map(move |[dx, du]| x * dx + u * du)
    }

    /// The series of a burst: output, and the index at which its samples begin.
    fn of_burst(&self, burst: usize) -> impl Iterator<Item = (usize, usize)> {
        self.series().filter(move |(of, ..)| *of == burst).map(|(_, output, at)| (output, at))
    }

    fn share(&self, output: usize) -> usize {
        shares(self.decays) + 2 * (output - 1)
    }

    pub fn predict(&self, p: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.len()];
        let motion = motion(self.decays, self.terms, p);
        let mut path_of = Vec::new();
        for burst in 0..self.decays.bursts {
            path(&motion, p, burst, self.upto, &mut path_of);
            for (output, at) in self.of_burst(burst) {
                y[at..].iter_mut().zip(self.seen(p, &path_of, output)).for_each(|(y, x)| *y += x);
            }
        }
        for (term, first) in placed(self.decays, self.terms) {
            match term {
                Term::Offset => self.series().for_each(|(_, output, at)| {
                    y[at..at + self.upto].iter_mut().for_each(|y| *y += p[first + output]);
                }),
                Term::Line(line) => self.each_wave(line, first, p, |_, amplitude, at, [c, s]| {
                    let (a, b) = (p[amplitude], p[amplitude + 1]);
                    (0..self.upto).for_each(|k| y[at + k] += a * c[k] + b * s[k]);
                }),
                _ => {}
            }
        }
        y
    }

    /// Calls `each` for each frequency of a line (side bands have two) and every series, with:
    /// which of the two side bands (0: above the ring); the index of its cosine's amplitude among
    /// the numbers (its sine's follows); the index at which the series begins; the damped cosine
    /// and sine. `first`: the index at which the line's numbers begin.
    fn each_wave(
        &self,
        line: Line,
        first: usize,
        p: &[f64],
        mut each: impl FnMut(usize, usize, usize, &[Vec<f64>; 2]),
    ) {
        let Decays { bursts, outputs, .. } = *self.decays;
        for (band, omega) in line.frequencies(p[OMEGA], p[first + 1]).into_iter().enumerate() {
            let both = waves(p[first], omega, self.upto);
            for (burst, output, at) in self.series() {
                let start = if line == Line::Tone { 0 } else { band * bursts + burst };
                each(band, first + 2 + 2 * (start * outputs + output), at, &both);
            }
        }
    }

    /// The numbers that the motion itself depends on, but for its starts, each with the step of its
    /// central difference, which changes the phase of a long decay by little.
    fn steps(&self, p: &[f64]) -> Vec<(usize, f64)> {
        let rates = [(SIGMA, 1e-6 * p[OMEGA].abs()), (OMEGA, 1e-7 * p[OMEGA].abs())];
        let of_terms = placed(self.decays, self.terms).flat_map(|(term, at)| {
            let numbers = 0..term.numbers(self.decays);
            numbers.filter_map(move |j| Some((at + j, term.step(j, self.decays.samples)?)))
        });
        rates.into_iter().chain(of_terms).collect()
    }

    /// Derivatives of all samples. A number on which a series does not depend has no column there.
    pub fn jacobian(&self, p: &[f64]) -> Jacobian {
        let series = self.decays.bursts * self.decays.outputs;
        let mut columns = Jacobian { upto: self.upto, series: vec![BTreeMap::new(); series] };
        let (mut up, mut down) = (Vec::new(), Vec::new());
        let shared = self.steps(p);
        for burst in 0..self.decays.bursts {
            let own = [0, 1].map(|j| (STARTS + 2 * burst + j, 1e-6));
            for &(j, h) in shared.iter().chain(&own) {
                for (sign, path_of) in [(1.0, &mut up), (-1.0, &mut down)] {
                    let mut moved = p.to_vec();
                    moved[j] += sign * h;
                    let motion = motion(self.decays, self.terms, &moved);
                    path(&motion, &moved, burst, self.upto, path_of);
                }
                for ([x, u], [down_x, down_u]) in up.iter_mut().zip(&down) {
                    *x -= down_x;
                    *u -= down_u;
                }
                for (output, at) in self.of_burst(burst) {
                    let column = columns.of(at, j);
                    let seen = self.seen(p, &up, output);
                    column.iter_mut().zip(seen).for_each(|(y, x)| *y += 0.5 / h * x);
                }
            }

            path(&motion(self.decays, self.terms, p), p, burst, self.upto, &mut up);
            for (output, at) in self.of_burst(burst).skip(1) {
                for j in [0, 1] {
                    let column = columns.of(at, self.share(output) + j);
                    column.iter_mut().zip(&up).for_each(|(y, moved)| *y = moved[j]);
                }
            }
        }
        self.add_offsets_and_lines(p, &mut columns);
        columns
    }

    fn add_offsets_and_lines(&self, p: &[f64], columns: &mut Jacobian) {
        for (term, first) in placed(self.decays, self.terms) {
            match term {
                Term::Offset => self.series().for_each(|(_, output, at)| {
                    columns.of(at, first + output).fill(1.0);
                }),
                Term::Line(line) => {
                    self.each_wave(line, first, p, |band, amplitude, at, [c, s]| {
                        let up = if band == 0 { 1.0 } else { -1.0 };
                        let (a, b) = (p[amplitude], p[amplitude + 1]);
                        let mut add = |number: usize, of: &dyn Fn(usize) -> f64| {
                            let column = columns.of(at, number);
                            column.iter_mut().enumerate().for_each(|(k, y)| *y += of(k));
                        };
                        // by the line's frequency; that of side bands is the ring's plus or minus
                        // the distance
                        let turned = |k: usize| k as f64 * (b * c[k] - a * s[k]);
                        if line.is_damped() {
                            add(first, &|k| -(k as f64) * (a * c[k] + b * s[k]));
                        }
                        if line == Line::SideBands {
                            add(OMEGA, &turned);
                        }
                        add(first + 1, &|k| up * turned(k));
                        add(amplitude, &|k| c[k]);
                        add(amplitude + 1, &|k| s[k]);
                    });
                }
                _ => {}
            }
        }
    }
}
