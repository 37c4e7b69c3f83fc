//! The model of long decays: one oscillator, and what may be added to it.
//!
//! In: a [`Structure`] and its parameters. Out: every sample, and its derivatives. Several outputs see
//! the same motion: the first as displacement, the others as a share of displacement and velocity each;
//! several bursts are several starts of it. Time counts in samples; every output is divided by its
//! largest sample. Derivatives of the motion are central differences, those of lines are exact.

use super::motion::{Form, Motion};
use super::unnamed::{self, Strengths, numbers};
use crate::critique::catalogue::CauseId;
use crate::critique::observations::Observations;

/// Decays of one system, [burst][output][sample].
#[derive(Clone, Debug)]
pub struct Decays {
    pub dt_s: f64,
    pub bursts: usize,
    pub outputs: usize,
    pub samples: usize,
    pub y: Vec<f64>,
    /// Of each output, in the order that is used here: the largest first.
    pub channels: Vec<u32>,
    /// What each output was divided by, counts.
    pub scale: Vec<f64>,
    /// Bursts in which an output is missing.
    pub incomplete: usize,
}

impl Decays {
    /// `None`: nothing is there, or the signals are not of one system.
    pub fn of(data: &Observations) -> Option<Decays> {
        if data.printheads.len() != 1 {
            return None;
        }
        let mut channels: Vec<u32> = data.rows.iter().map(|r| r.beside.channel).collect();
        channels.sort_unstable();
        channels.dedup();
        let n = data.samples;
        let mut bursts: Vec<Vec<Option<usize>>> = vec![vec![None; channels.len()]; data.bursts];
        for (i, row) in data.rows.iter().enumerate() {
            let output = channels.binary_search(&row.beside.channel).ok()?;
            bursts[row.burst][output] = Some(i);
        }
        let mut whole: Vec<Vec<usize>> =
            bursts.iter().filter_map(|b| b.iter().copied().collect()).collect();
        whole.sort_by_key(|b| data.rows[b[0]].beside.t_acq_ns);
        if whole.is_empty() || channels.is_empty() {
            return None;
        }
        // the output that moves most against its own last samples is the displacement
        let spread = |o: usize| -> (f64, f64) {
            let all = || whole.iter().flat_map(|b| data.signal(b[o])).map(|y| f64::from(*y));
            let mean = all().sum::<f64>() / (n * whole.len()) as f64;
            let largest = all().fold(0.0_f64, |m, y| m.max((y - mean).abs()));
            (largest, all().map(|y| (y - mean).powi(2)).sum::<f64>())
        };
        let mut order: Vec<usize> = (0..channels.len()).collect();
        order.sort_by(|p, q| spread(*q).1.total_cmp(&spread(*p).1));
        let scale: Vec<f64> = order.iter().map(|&o| spread(o).0).collect();
        if scale.iter().any(|s| s.is_nan() || *s <= 0.0) {
            return None;
        }
        let mut y = Vec::with_capacity(whole.len() * order.len() * n);
        for burst in &whole {
            for (&o, s) in order.iter().zip(&scale) {
                y.extend(data.signal(burst[o]).iter().map(|v| f64::from(*v) / s));
            }
        }
        Some(Decays {
            dt_s: data.dt_s,
            bursts: whole.len(),
            outputs: order.len(),
            samples: n,
            y,
            channels: order.iter().map(|&o| channels[o]).collect(),
            scale,
            incomplete: data.bursts - whole.len(),
        })
    }

    pub fn series(&self, burst: usize, output: usize) -> &[f64] {
        let at = (burst * self.outputs + output) * self.samples;
        &self.y[at..at + self.samples]
    }
}

/// An added oscillation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A damped mode: every burst starts it anew.
    Mode,
    /// Undamped, and the same in all bursts: it comes from outside.
    Tone,
}

/// Which terms there are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Structure {
    pub stiffness: Option<Form>,
    pub drag: bool,
    pub friction: bool,
    pub unnamed: Vec<CauseId>,
    pub offset: bool,
    pub lines: Vec<Line>,
}

/// Where the parameters of a structure stand.
#[derive(Clone, Debug)]
pub struct Layout {
    pub stiffness: Option<usize>,
    pub drag: Option<usize>,
    pub friction: Option<usize>,
    /// Each rival without a name, and where its numbers begin.
    pub unnamed: Vec<(CauseId, usize)>,
    /// x and x'/omega of each burst's first sample.
    pub starts: usize,
    /// Shares of displacement and velocity of every output but the first.
    pub shares: usize,
    pub offset: Option<usize>,
    /// sigma (0 for a tone), omega, then cosine and sine of each output (of each burst).
    pub lines: Vec<usize>,
    pub count: usize,
}

pub const SIGMA: usize = 0;
pub const OMEGA: usize = 1;

impl Structure {
    pub fn layout(&self, bursts: usize, outputs: usize) -> Layout {
        let mut next = 2;
        let mut take = |wanted: bool, count: usize| {
            let at = next;
            next += if wanted { count } else { 0 };
            at
        };
        let some = |wanted: bool, at: usize| wanted.then_some(at);
        let stiffness = some(self.stiffness.is_some(), take(self.stiffness.is_some(), 1));
        let drag = some(self.drag, take(self.drag, 1));
        let friction = some(self.friction, take(self.friction, 1));
        let rivals = self.unnamed.iter().map(|what| (*what, take(true, numbers(*what))));
        let unnamed = rivals.collect();
        let starts = take(true, 2 * bursts);
        let shares = take(true, 2 * (outputs - 1));
        let offset = some(self.offset, take(self.offset, outputs));
        let lines = self.lines.iter().map(|l| take(true, 2 + 2 * l.starts(bursts) * outputs));
        let lines = lines.collect();
        Layout { stiffness, drag, friction, unnamed, starts, shares, offset, lines, count: next }
    }

    /// The same parameters where more (or fewer) terms are: what is new is zero.
    pub fn carried(&self, from: &Structure, p: &[f64], decays: &Decays) -> Vec<f64> {
        let (b, o) = (decays.bursts, decays.outputs);
        let (old, new) = (from.layout(b, o), self.layout(b, o));
        let mut q = vec![0.0; new.count];
        let mut copy = |to: Option<usize>, at: Option<usize>, count: usize| {
            if let (Some(to), Some(at)) = (to, at) {
                q[to..to + count].copy_from_slice(&p[at..at + count]);
            }
        };
        copy(Some(SIGMA), Some(SIGMA), 2);
        copy(new.stiffness, old.stiffness, 1);
        copy(new.drag, old.drag, 1);
        copy(new.friction, old.friction, 1);
        for (what, to) in &new.unnamed {
            let at = old.unnamed.iter().find(|(w, _)| w == what).map(|(_, at)| *at);
            copy(Some(*to), at, numbers(*what));
        }
        copy(Some(new.starts), Some(old.starts), 2 * b);
        copy(Some(new.shares), Some(old.shares), 2 * (o - 1));
        copy(new.offset, old.offset, o);
        for (i, (to, at)) in new.lines.iter().zip(&old.lines).enumerate() {
            copy(Some(*to), Some(*at), 2 + 2 * self.lines[i].starts(b) * o);
        }
        q
    }
}

impl Line {
    pub fn starts(self, bursts: usize) -> usize {
        if self == Line::Mode { bursts } else { 1 }
    }
}

pub fn motion(structure: &Structure, layout: &Layout, p: &[f64]) -> Motion {
    let at = |place: Option<usize>| place.map_or(0.0, |i| p[i]);
    let mut unnamed = Strengths::NONE;
    for (what, i) in &layout.unnamed {
        unnamed.set(*what, &p[*i..i + numbers(*what)]);
    }
    Motion {
        sigma: p[SIGMA],
        omega: p[OMEGA],
        form: structure.stiffness.unwrap_or(Form::Cubic),
        stiffness: at(layout.stiffness),
        drag: at(layout.drag),
        stick: at(layout.friction),
        unnamed,
    }
}

/// A structure on some decays, of which the first `upto` samples are looked at.
pub struct Plant<'a> {
    pub decays: &'a Decays,
    pub structure: &'a Structure,
    pub layout: Layout,
    pub upto: usize,
}

impl<'a> Plant<'a> {
    pub fn new(decays: &'a Decays, structure: &'a Structure, upto: usize) -> Plant<'a> {
        let layout = structure.layout(decays.bursts, decays.outputs);
        Plant { decays, structure, layout, upto: upto.min(decays.samples) }
    }

    pub fn len(&self) -> usize {
        self.decays.bursts * self.decays.outputs * self.upto
    }

    fn place(&self, burst: usize, output: usize) -> usize {
        (burst * self.decays.outputs + output) * self.upto
    }

    /// What is measured, cut to what is looked at.
    pub fn measured(&self) -> Vec<f64> {
        let d = self.decays;
        let pairs = (0..d.bursts).flat_map(|b| (0..d.outputs).map(move |o| (b, o)));
        pairs.flat_map(|(b, o)| d.series(b, o)[..self.upto].iter().copied()).collect()
    }

    /// Adds `times` the motion of one burst, as all outputs see it.
    fn add_motion(&self, p: &[f64], path: &[[f64; 2]], burst: usize, times: f64, into: &mut [f64]) {
        for output in 0..self.decays.outputs {
            let (x, u) = self.share(p, output);
            let at = self.place(burst, output);
            for (y, [dx, du]) in into[at..at + self.upto].iter_mut().zip(path) {
                *y += times * (x * dx + u * du);
            }
        }
    }

    fn share(&self, p: &[f64], output: usize) -> (f64, f64) {
        match output {
            0 => (1.0, 0.0),
            o => {
                let at = self.layout.shares + 2 * (o - 1);
                (p[at], p[at + 1])
            }
        }
    }

    pub fn predict(&self, p: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.len()];
        let motion = motion(self.structure, &self.layout, p);
        let mut path = Vec::new();
        for burst in 0..self.decays.bursts {
            let at = self.layout.starts + 2 * burst;
            motion.run([p[at], p[at + 1]], self.upto, &mut path);
            self.add_motion(p, &path, burst, 1.0, &mut y);
        }
        if let Some(offset) = self.layout.offset {
            for burst in 0..self.decays.bursts {
                for output in 0..self.decays.outputs {
                    let at = self.place(burst, output);
                    y[at..at + self.upto].iter_mut().for_each(|y| *y += p[offset + output]);
                }
            }
        }
        for (line, &first) in self.structure.lines.iter().zip(&self.layout.lines) {
            let (c, s) = waves(p[first], p[first + 1], self.upto);
            self.each_start(*line, first, |amplitude, at| {
                let (a, b) = (p[amplitude], p[amplitude + 1]);
                for k in 0..self.upto {
                    y[at + k] += a * c[k] + b * s[k];
                }
            });
        }
        y
    }

    /// Calls with the place of cosine and sine among the parameters, and of the series they are in.
    fn each_start(&self, line: Line, first: usize, mut f: impl FnMut(usize, usize)) {
        for burst in 0..self.decays.bursts {
            for output in 0..self.decays.outputs {
                let start = if line == Line::Mode { burst } else { 0 };
                let amplitude = first + 2 + 2 * (start * self.decays.outputs + output);
                f(amplitude, self.place(burst, output));
            }
        }
    }

    /// One column per parameter.
    pub fn jacobian(&self, p: &[f64]) -> Vec<Vec<f64>> {
        let mut columns = vec![vec![0.0; self.len()]; self.layout.count];
        let l = &self.layout;
        let shared = [Some(SIGMA), Some(OMEGA), l.stiffness, l.drag, l.friction];
        let (mut up, mut down) = (Vec::new(), Vec::new());
        let samples = self.decays.samples;
        let of_rivals: Vec<(usize, f64)> = l
            .unnamed
            .iter()
            .flat_map(|(what, at)| {
                (0..numbers(*what)).map(move |j| (at + j, unnamed::step(*what, j, samples)))
            })
            .collect();
        let run = |p: &[f64], burst: usize, path: &mut Vec<[f64; 2]>| {
            let at = l.starts + 2 * burst;
            motion(self.structure, l, p).run([p[at], p[at + 1]], self.upto, path);
        };
        for burst in 0..self.decays.bursts {
            let own = [Some(l.starts + 2 * burst), Some(l.starts + 2 * burst + 1)];
            // steps that move the phase of a long decay by little
            let named = shared.into_iter().chain(own).flatten().map(|j| match j {
                SIGMA => (j, 1e-6 * p[OMEGA].abs()),
                OMEGA => (j, 1e-7 * p[OMEGA].abs()),
                _ => (j, 1e-6),
            });
            for (j, h) in named.chain(of_rivals.iter().copied()) {
                let (mut high, mut low) = (p.to_vec(), p.to_vec());
                high[j] += h;
                low[j] -= h;
                run(&high, burst, &mut up);
                run(&low, burst, &mut down);
                up.iter_mut().zip(&down).for_each(|(u, d)| {
                    u[0] -= d[0];
                    u[1] -= d[1];
                });
                self.add_motion(p, &up, burst, 0.5 / h, &mut columns[j]);
            }
            run(p, burst, &mut up);
            for output in 1..self.decays.outputs {
                let (at, place) = (l.shares + 2 * (output - 1), self.place(burst, output));
                for (k, [x, u]) in up.iter().enumerate() {
                    columns[at][place + k] = *x;
                    columns[at + 1][place + k] = *u;
                }
            }
            if let Some(offset) = l.offset {
                for output in 0..self.decays.outputs {
                    let place = self.place(burst, output);
                    columns[offset + output][place..place + self.upto].fill(1.0);
                }
            }
        }
        self.of_lines(p, &mut columns);
        columns
    }

    /// The columns of added oscillations.
    fn of_lines(&self, p: &[f64], columns: &mut [Vec<f64>]) {
        for (line, &first) in self.structure.lines.iter().zip(&self.layout.lines) {
            let (c, s) = waves(p[first], p[first + 1], self.upto);
            self.each_start(*line, first, |amplitude, at| {
                let (a, b) = (p[amplitude], p[amplitude + 1]);
                for k in 0..self.upto {
                    let t = k as f64;
                    if *line == Line::Mode {
                        columns[first][at + k] = -t * (a * c[k] + b * s[k]);
                    }
                    columns[first + 1][at + k] = t * (b * c[k] - a * s[k]);
                    columns[amplitude][at + k] = c[k];
                    columns[amplitude + 1][at + k] = s[k];
                }
            });
        }
    }
}

/// Damped cosine and sine.
fn waves(sigma: f64, omega: f64, n: usize) -> (Vec<f64>, Vec<f64>) {
    let fall = (-sigma).exp();
    let (sin, cos) = omega.sin_cos();
    let (mut c, mut s) = (vec![0.0; n], vec![0.0; n]);
    let (mut x, mut y) = (1.0, 0.0);
    for k in 0..n {
        (c[k], s[k]) = (x, y);
        (x, y) = (fall * (x * cos - y * sin), fall * (y * cos + x * sin));
    }
    (c, s)
}
