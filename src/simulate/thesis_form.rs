//! The data set of thesis §4-1 in the thesis's form. In: a `classes` scenario. Out: `train` and
//! `test` as bursts of one printhead, and the truth per channel.
//!
//! Each signal is a damped oscillation and a slow decay, its numbers uniform in the box of its
//! class. The boxes come from the scenario file alone.

use super::burst_shape::digitise;
use super::dataset::{Common, Set, Truth, labels_of, mixed, placed, recordings_of};
use super::scenario::{ClassBox, Classes, RecordingOptions};
use super::{Purpose, SimulatedRecording, part, stream};
use crate::labels::Label;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;
use std::sync::Arc;

/// One draw from a class box: y(t) = A (e^{-sigma t} cos(2 pi f t + phi0) + rho e^{-lambda t}).
#[derive(Clone, Copy, Debug)]
struct Decay {
    amplitude_counts: f64,
    sigma_per_s: f64,
    freq_hz: f64,
}

impl Decay {
    fn draw(class: &ClassBox, rng: &mut impl rand::Rng) -> Decay {
        let mut within = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        Decay {
            amplitude_counts: within(class.amplitude_counts),
            sigma_per_s: within(class.sigma_per_s),
            freq_hz: within(class.freq_hz),
        }
    }

    fn at(&self, t_s: f64, form: &Classes) -> f64 {
        let ringing =
            (-self.sigma_per_s * t_s).exp() * (TAU * self.freq_hz * t_s + form.phi0_rad).cos();
        self.amplitude_counts * (ringing + form.rho * (-form.lambda_per_s * t_s).exp())
    }
}

fn sets(classes: &Classes, seed: u64) -> Vec<Set> {
    let fault_classes = classes.fault_classes().len();
    let set = |(stem, part)| {
        let mut rng = stream(seed, Purpose::Truth, part);
        let (healthy, per_fault) = (classes.n_healthy, classes.n_per_fault);
        (stem, part, mixed(healthy, per_fault, fault_classes, &mut rng, |_, _| f64::NAN))
    };
    placed([("train", part::TRAIN), ("test", part::TEST)].map(set).into())
}

pub(super) fn labels(classes: &Classes, seed: u64) -> Vec<Label> {
    let names = classes.fault_classes();
    labels_of(&sets(classes, seed), |truth| truth.class.map(|i| (names[i].0.clone(), None)))
}

pub(super) fn recordings(
    classes: &Arc<Classes>,
    options: &RecordingOptions,
    seed: u64,
) -> Vec<SimulatedRecording> {
    let common = Common {
        sample_period_s: classes.sample_period_s(),
        samples: classes.n,
        temperature_c: None,
        drive_voltage_v: None,
    };
    recordings_of(sets(classes, seed), options, common, |part| {
        let form = classes.clone();
        let boxes: Vec<ClassBox> =
            form.fault_classes().into_iter().map(|(_, class)| class).collect();
        let mut spread = stream(seed, Purpose::Spread, part);
        let mut noise = stream(seed, Purpose::Noise, part);
        move |truth: &Truth, counts: &mut Vec<i16>| {
            let class = truth.class.map_or(&form.classes.healthy, |i| &boxes[i]);
            let decay = Decay::draw(class, &mut spread);
            counts.extend((0..form.n).map(|k| {
                let white: f64 = noise.sample(StandardNormal);
                let t_s = k as f64 * form.sample_period_s();
                digitise(decay.at(t_s, &form) + form.noise_sd_counts * white)
            }));
        }
    })
}
