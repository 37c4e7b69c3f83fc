//! The model of long decays: one oscillator, and what may be added to it.
//!
//! In: terms, and their numbers after the oscillator's own. Out: every sample, and its derivatives. Several outputs see
//! the same motion: the first as displacement, the others as a share of displacement and velocity each;
//! several bursts are several starts of it. Time counts in samples. Derivatives of the motion are central differences,
//! those of offsets and lines are exact.

use super::decays::Decays;
use super::motion::Motion;
use super::terms::{Line, Term};
use crate::critique::waves::waves;

/// Places of the oscillator's own numbers: its rates, x and x'/omega of each burst's first sample, then the shares of
/// displacement and velocity of every output but the first. Those of the terms follow, in the terms' order.
pub const SIGMA: usize = 0;
pub const OMEGA: usize = 1;
const STARTS: usize = 2;

fn shares(decays: &Decays) -> usize {
    STARTS + 2 * decays.bursts
}

/// How many numbers the oscillator has without any terms.
pub fn plain_numbers(decays: &Decays) -> usize {
    shares(decays) + 2 * (decays.outputs - 1)
}

/// Each term, and where its numbers begin.
pub fn placed(decays: &Decays, terms: &[Term]) -> impl Iterator<Item = (Term, usize)> {
    terms.iter().scan(plain_numbers(decays), |next, term| {
        let at = *next;
        *next += term.numbers(decays);
        Some((*term, at))
    })
}

/// The motion that all outputs see.
pub fn motion(decays: &Decays, terms: &[Term], p: &[f64]) -> Motion {
    let mut motion = Motion::linear(p[SIGMA], p[OMEGA]);
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

/// x and x'/omega of one burst at every sample.
pub fn path(motion: &Motion, p: &[f64], burst: usize, samples: usize, out: &mut Vec<[f64; 2]>) {
    let at = STARTS + 2 * burst;
    motion.run([p[at], p[at + 1]], samples, out);
}

/// The oscillator with terms on some decays, of which the first `upto` samples are looked at.
pub struct Plant<'a> {
    decays: &'a Decays,
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

    /// Burst and output of every series, and where it begins.
    fn series(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        let (outputs, upto) = (self.decays.outputs, self.upto);
        (0..self.decays.bursts * outputs).map(move |i| (i / outputs, i % outputs, i * upto))
    }

    /// What is measured, cut to what is looked at.
    pub fn measured(&self) -> Vec<f64> {
        let of = |(burst, output, _)| &self.decays.series(burst, output)[..self.upto];
        self.series().flat_map(of).copied().collect()
    }

    /// Adds `times` the motion of one burst, as all outputs see it.
    fn add_motion(&self, p: &[f64], path: &[[f64; 2]], burst: usize, times: f64, into: &mut [f64]) {
        for (_, output, at) in self.series().filter(|(of, ..)| *of == burst) {
            let (x, u) = match output {
                0 => (1.0, 0.0),
                _ => (p[self.share(output)], p[self.share(output) + 1]),
            };
            for (y, [dx, du]) in into[at..at + self.upto].iter_mut().zip(path) {
                *y += times * (x * dx + u * du);
            }
        }
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
            self.add_motion(p, &path_of, burst, 1.0, &mut y);
        }
        for (term, first) in placed(self.decays, self.terms) {
            match term {
                Term::Offset => self.series().for_each(|(_, output, at)| {
                    y[at..at + self.upto].iter_mut().for_each(|y| *y += p[first + output]);
                }),
                Term::Line(line) => {
                    for (band, omega) in line.frequencies(p[OMEGA], p[first + 1]).iter().enumerate()
                    {
                        let [c, s] = waves(p[first], *omega, self.upto);
                        for (amplitude, at) in self.amplitudes(line, band, first) {
                            let (a, b) = (p[amplitude], p[amplitude + 1]);
                            (0..self.upto).for_each(|k| y[at + k] += a * c[k] + b * s[k]);
                        }
                    }
                }
                _ => {}
            }
        }
        y
    }

    /// The place of a line's cosine and sine among the numbers, and of each series they are in; `band`: of side bands, which.
    fn amplitudes(
        &self,
        line: Line,
        band: usize,
        first: usize,
    ) -> impl Iterator<Item = (usize, usize)> {
        let Decays { bursts, outputs, .. } = *self.decays;
        let of = move |(burst, output, at)| {
            let start = if line == Line::Tone { 0 } else { band * bursts + burst };
            (first + 2 + 2 * (start * outputs + output), at)
        };
        self.series().map(of)
    }

    /// Numbers that the motion itself depends on, but for its starts, and by how much each is moved to learn what that
    /// changes: by little of the phase of a long decay.
    fn steps(&self, p: &[f64]) -> Vec<(usize, f64)> {
        let rates = [(SIGMA, 1e-6 * p[OMEGA].abs()), (OMEGA, 1e-7 * p[OMEGA].abs())];
        let of_terms = placed(self.decays, self.terms).flat_map(|(term, at)| {
            let numbers = 0..term.numbers(self.decays);
            numbers.filter_map(move |j| Some((at + j, term.step(j, self.decays.samples)?)))
        });
        rates.into_iter().chain(of_terms).collect()
    }

    /// One column per number.
    pub fn jacobian(&self, p: &[f64]) -> Vec<Vec<f64>> {
        let mut columns = vec![vec![0.0; self.len()]; p.len()];
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
                self.add_motion(p, &up, burst, 0.5 / h, &mut columns[j]);
            }

            path(&motion(self.decays, self.terms, p), p, burst, self.upto, &mut up);
            for (_, output, place) in self.series().filter(|(of, ..)| *of == burst).skip(1) {
                let at = self.share(output);
                for (k, [x, u]) in up.iter().enumerate() {
                    columns[at][place + k] = *x;
                    columns[at + 1][place + k] = *u;
                }
            }
        }
        self.add_offsets_and_lines(p, &mut columns);
        columns
    }

    /// The columns of what does not depend on the motion.
    fn add_offsets_and_lines(&self, p: &[f64], columns: &mut [Vec<f64>]) {
        for (term, first) in placed(self.decays, self.terms) {
            match term {
                Term::Offset => self.series().for_each(|(_, output, at)| {
                    columns[first + output][at..at + self.upto].fill(1.0);
                }),
                Term::Line(line) => {
                    for (band, omega) in line.frequencies(p[OMEGA], p[first + 1]).iter().enumerate()
                    {
                        let [c, s] = waves(p[first], *omega, self.upto);
                        let up = if band == 0 { 1.0 } else { -1.0 };
                        for (amplitude, at) in self.amplitudes(line, band, first) {
                            let (a, b) = (p[amplitude], p[amplitude + 1]);
                            for k in 0..self.upto {
                                let t = k as f64;
                                let turned = t * (b * c[k] - a * s[k]);
                                if line.is_damped() {
                                    columns[first][at + k] -= t * (a * c[k] + b * s[k]);
                                }
                                if line == Line::SideBands {
                                    columns[OMEGA][at + k] += turned;
                                }
                                columns[first + 1][at + k] += up * turned;
                                columns[amplitude][at + k] = c[k];
                                columns[amplitude + 1][at + k] = s[k];
                            }
                        }
                    }
                }
                _ => {}
            }
        }
    }
}
