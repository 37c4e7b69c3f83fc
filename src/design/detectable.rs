//! Which faults an identified channel lets a filter see, before any is labelled.
//!
//! In: an identified model, the filter's settings. Out: the nullity of H-bar and what disturbances
//! leave of it, per fault class detectable and strongly detectable, and where the denominator is
//! blind. thesis (3-2), (3-3), §3-2-1.

use super::DesignError;
use super::fd_filter::by_resonance;
use crate::detect::decoupling::decoupled;
use crate::detect::detectability::{FaultyModel, blind_ranges};
use crate::detect::{DetectError, DetectSettings, ResidualGenerator, null_space};
use crate::fault::CLASSES;
use crate::identify::grey_box::Identification;
use crate::model::{InkChannel, faults};
use nalgebra::{DMatrix, dmatrix};
use serde::Serialize;

/// A filter that answers a frequency with less of its largest answer than this is blind to it. The
/// largest is the undamped pair's, some thousand times what it answers elsewhere.
const BLIND: f64 = 1e-6;
/// Steps over 0 .. half the sample rate.
const STEPS: usize = 8192;

/// What can be seen of a channel's faults.
#[derive(Clone, Debug, Serialize)]
pub struct Detectable {
    /// Of the filter.
    pub degree: usize,
    /// Filters of that degree that no healthy signal excites, independent of each other: (3-3a).
    pub nullity: usize,
    pub classes: Vec<ClassSeen>,
    /// Disturbances of any shape in time, and what decoupling each of them leaves.
    pub disturbances: Vec<Decoupling>,
    /// Frequencies that the filter answers with less than a millionth of its largest answer, Hz.
    pub blind_hz: Vec<[f64; 2]>,
}

/// A fault class by the physics, in the middle of its severities.
#[derive(Clone, Debug, Serialize)]
pub struct ClassSeen {
    pub class: &'static str,
    /// Some filter that the state does not excite answers to it.
    pub detectable: bool,
    /// The answer to a fault that pushes for good stays.
    pub strongly: bool,
}

#[derive(Clone, Debug, Serialize)]
pub struct Decoupling {
    pub what: &'static str,
    pub nullity: usize,
    /// Classes that are still detectable.
    pub still_seen: Vec<&'static str>,
}

impl Detectable {
    /// With the filter of method I. `samples`, `dt_s`: of a signal.
    pub fn of(
        identification: &Identification,
        samples: usize,
        dt_s: f64,
        settings: &DetectSettings,
    ) -> Result<Detectable, DesignError> {
        let channel = identification.channel;
        let denominator = by_resonance(identification, samples, settings, dt_s)?;
        let degree = denominator.len() - 1;
        let (a, c) = (channel.a(), channel.c());
        let nullity = null_space::annihilator(&a, &c, dt_s, degree)?.n_bar.nrows();
        let numerator = null_space::numerator(&a, &c, dt_s, degree)?;
        let filter = ResidualGenerator::new(numerator, denominator, dt_s)?;

        let none = DMatrix::zeros(3, 0);
        let classes = CLASSES
            .into_iter()
            .map(|class| {
                let (detectable, strongly) = seen(&channel, class, &none, &DMatrix::zeros(1, 0))?;
                Ok(ClassSeen { class, detectable, strongly })
            })
            .collect::<Result<Vec<_>, DetectError>>()?;
        let (a3, c3) = observable(&channel);
        let (a_s, no_force) = (a3.map(|v| v * 1e6), DMatrix::zeros(3, 1));
        let supply = dmatrix![0.0; a3[(1, 0)]; a3[(2, 0)]];
        let disturbances = [
            ("the supply: acts as the actuation does", supply, DMatrix::zeros(1, 1)),
            ("the sensor: adds to the output", no_force, dmatrix![1.0]),
        ];
        let disturbances = disturbances
            .into_iter()
            .map(|(what, b_d, d_d)| {
                let b_s = b_d.map(|v| v * 1e6);
                let nullity = match decoupled(&a_s, &c3, &b_s, &d_d, dt_s, degree) {
                    Ok(left) => left.rows.len(),
                    Err(DetectError::DegreeTooSmall { .. }) => 0,
                    Err(e) => return Err(e),
                };
                let mut still_seen = Vec::new();
                for class in CLASSES {
                    if seen(&channel, class, &b_d, &d_d)?.0 {
                        still_seen.push(class);
                    }
                }
                Ok(Decoupling { what, nullity, still_seen })
            })
            .collect::<Result<Vec<_>, DetectError>>()?;
        let blind = blind_ranges(&filter, BLIND, STEPS).into_iter();
        let blind_hz = blind.map(|(from, to)| [from, to]).collect();
        Ok(Detectable { degree, nullity, classes, disturbances, blind_hz })
    }
}

/// thesis (2-2) in its observable states: volume in the chamber (V_r + V_n), flow through restrictor
/// and nozzle. The volumes' difference is at rest anywhere and reaches no output; left in, it would
/// make every constant fault look like one that stays. Per µs.
fn observable(channel: &InkChannel) -> (DMatrix<f64>, DMatrix<f64>) {
    let InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s } = *channel;
    let [a, b] = [a_per_s2, b_per_s2].map(|v| v * 1e-12);
    let [g, d] = [g_per_s, d_per_s].map(|v| v * 1e-6);
    (dmatrix![0.0, 1.0, 1.0; -a, -g, 0.0; -b, 0.0, -d], dmatrix![0.0, 1.0, 1.0])
}

/// Whether a class is detectable and strongly so beside a disturbance. Its B_f = A_f - A, thesis (2-1),
/// acts in as many directions as its rank has; one that is seen suffices.
fn seen(
    channel: &InkChannel,
    class: &str,
    b_d: &DMatrix<f64>,
    d_d: &DMatrix<f64>,
) -> Result<(bool, bool), DetectError> {
    let middle = faults::law(class).and_then(|law| {
        let [least, most] = law.range();
        law.apply(0.5 * (least + most), channel)
    });
    let Some(faulty) = middle else { return Ok((false, false)) };
    let (a, c) = observable(channel);
    let b_f = observable(&faulty).0 - &a;
    // forces on the restrictor's ink and on the nozzle's: alike in their dependence on the state, or not
    let (of_restrictor, of_nozzle) = (b_f.row(1), b_f.row(2));
    let (r, n, both) = (of_restrictor.norm(), of_nozzle.norm(), of_restrictor.dot(&of_nozzle));
    let alike = r == 0.0 || n == 0.0 || both.abs() > (1.0 - 1e-9) * r * n;
    let directions = match alike {
        true => dmatrix![0.0; r; if both < 0.0 { -n } else { n }],
        false => dmatrix![0.0, 0.0; 1.0, 0.0; 0.0, 1.0],
    };
    let d_f = DMatrix::zeros(1, directions.ncols());
    let model = FaultyModel { a, c, b_f: directions, d_f, b_d: b_d.clone(), d_d: d_d.clone() };
    let found = model.detectability()?;
    Ok((found.detectable.contains(&true), found.strongly.contains(&true)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;

    const INK: InkChannel = InkChannel::NOMINAL;

    #[test]
    fn the_observable_states_have_the_channels_transfer_from_every_force() {
        let (a3, c3) = observable(&INK);
        let slow = InkChannel {
            a_per_s2: INK.a_per_s2 * 1e-12,
            b_per_s2: INK.b_per_s2 * 1e-12,
            g_per_s: INK.g_per_s * 1e-6,
            d_per_s: INK.d_per_s * 1e-6,
        };
        let (a4, c4) = (slow.a(), slow.c());
        let answer = |a: &DMatrix<f64>, c: &DMatrix<f64>, force: usize, s: Complex<f64>| {
            let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
            let n = a.nrows();
            let mut b = DMatrix::from_element(n, 1, Complex::new(0.0, 0.0));
            b[(n - 2 + force, 0)] = Complex::new(1.0, 0.0);
            let x = (DMatrix::identity(n, n) * s - complex(a)).lu().solve(&b).unwrap();
            (complex(c) * x)[(0, 0)]
        };
        for s in [Complex::new(0.1, 0.3), Complex::new(0.0, 0.41), Complex::new(-0.01, 0.9)] {
            for force in [0, 1] {
                let (three, four) = (answer(&a3, &c3, force, s), answer(&a4, &c4, force, s));
                assert!((three - four).norm() < 1e-12 * four.norm(), "{three} {four}");
            }
        }
    }

    /// The sensor sees flow: what pushes for good moves ink once and then no more.
    #[test]
    fn every_class_is_detectable_none_strongly_and_one_sensor_decouples_nothing() {
        let none = (DMatrix::zeros(3, 0), DMatrix::zeros(1, 0));
        for class in CLASSES {
            assert_eq!(seen(&INK, class, &none.0, &none.1).unwrap(), (true, false), "{class}");
            let sensor = (DMatrix::zeros(3, 1), dmatrix![1.0]);
            assert!(!seen(&INK, class, &sensor.0, &sensor.1).unwrap().0, "{class}");
        }
        assert_eq!(seen(&INK, "leak", &none.0, &none.1).unwrap(), (false, false));
        // and with a second sensor, of the chamber's volume, what the nozzle does is told from it
        let (a, _) = observable(&INK);
        let model = FaultyModel {
            a,
            c: dmatrix![0.0, 1.0, 1.0; 1.0, 0.0, 0.0],
            b_f: dmatrix![0.0; 0.0; 1.0],
            d_f: DMatrix::zeros(2, 1),
            b_d: DMatrix::zeros(3, 1),
            d_d: dmatrix![1.0; 0.0],
        };
        let found = model.detectability().unwrap();
        assert_eq!((found.detectable, found.strongly), (vec![true], vec![true]));
    }
}
