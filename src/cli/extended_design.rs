//! Makes a design that `replay` loads from the extended model of a critique.
//!
//! In: the signals that a critique kept, and its extended model, from `critique`. Out: a design
//! with an [`Extension`] and without fault classes. The effects of the causes are subtracted from
//! the signals before the design is trained on them, and the extension subtracts the same from
//! every signal that the design judges.

use crate::settings::Settings;
use inkling_core::design::{Covariate, CovariateEffect, Design, Extension, TrainingSet};
use inkling_core::identify::SignalSet;
use inkling_lab::critique::catalogue::CauseId;
use inkling_lab::critique::covariates::{self, Covariates};
use inkling_lab::critique::engine::{Extended, Outcome};
use inkling_lab::critique::model::with_its_pole;
use inkling_lab::critique::observations::Observations;

/// The covariates that a design can follow. Temperature is not one of them, as the design's healthy models
/// learn its effect themselves.
const FOLLOWED: [(usize, Covariate); 5] = [
    (covariates::TIME, Covariate::Time),
    (covariates::POSITION, Covariate::Channel),
    (covariates::NEIGHBOURS, Covariate::Neighbours),
    (covariates::IDLE, Covariate::LnIdle),
    (covariates::DRIVE, Covariate::Drive),
];

/// Trains the design on the signals of a critique (`data`), as its `outcome` extends the model. The
/// error says in words why there is no design.
pub fn train(
    data: &Observations,
    outcome: &Outcome,
    settings: &Settings,
) -> Result<Design, String> {
    let extended = outcome.extended.as_ref().map_err(ToString::to_string)?;
    let Extended { beside, .. } = extended;
    // signals that the critique left out as outliers are not trained on
    let kept: Vec<usize> = (0..data.len()).filter(|&i| !outcome.outlier[i]).collect();
    let first_ns = kept.iter().map(|&i| data.rows[i].beside.t_acq_ns).min().unwrap_or(0);
    let extension = extension(extended, first_ns as f64 * 1e-9);

    // the training set: all kept signals are healthy ones, by printhead, less what the extension
    // says
    let mut set = TrainingSet {
        sample_period_s: data.dt_s,
        samples: data.samples,
        drive_voltage_v: beside.drive_mean_v,
        extension,
        ..TrainingSet::default()
    };
    for (&i, &drive) in kept.iter().zip(&beside.drive) {
        let row = &data.rows[i];
        let mut signal: Vec<f64> = data.signal(i).iter().map(|y| f64::from(*y)).collect();
        if let Some(extension) = &set.extension {
            extension.subtract(&row.beside, drive, data.dt_s, &mut signal);
        }
        let signal: Vec<f32> = signal.iter().map(|y| *y as f32).collect();
        let of_head = set.healthy.entry(data.printheads[row.printhead].clone());
        let of_head = of_head.or_insert_with(|| SignalSet::new(data.samples));
        of_head.push(&signal, drive, &row.beside);
    }
    set.signals.insert(inkling_core::fault::HEALTHY.into(), kept.len() as u64);
    let Settings { identify, detect, isolate, .. } = settings;
    let trained = Design::train(&set, &identify.grey_box, detect, isolate);
    trained.map(|(design, _)| design).map_err(|e| e.to_string())
}

/// The extension of the design: the same numbers as in the critique's model, in the units in which
/// a design keeps them. `None` if the causes change nothing of the expected signal. `start_s`: time
/// of the first kept signal since the epoch, s, from which the critique counted time.
fn extension(extended: &Extended, start_s: f64) -> Option<Extension> {
    let Extended { causes, model, beside } = extended;
    // 1. What the decay follows. The critique standardised each covariate to z = (value - mean) /
    // sd, and has slopes per z; a design follows covariates in their own units, so slopes are
    // divided by sd.
    let moved = |which: usize| model.added.beta[which].iter().any(|v| *v != 0.0);
    let follows = FOLLOWED
        .iter()
        .filter(|(which, _)| moved(*which) && beside.present[*which])
        .map(|&(which, covariate)| {
            let since = if which == covariates::TIME { start_s } else { 0.0 };
            let (mean, sd) = (beside.mean[which] + since, beside.sd[which]);
            let [least, most] = range(beside, which);
            CovariateEffect {
                covariate,
                about: mean,
                range: [mean + sd * least, mean + sd * most],
                slope: with_its_pole(model.added.beta[which] / sd).into(),
            }
        })
        .collect();

    // 2. The shapes that are added to every signal, one for each power of the drive. Shapes that
    // are all 0 are emptied, and empty ones at the end removed.
    let mut shapes: Vec<Vec<f64>> = model.added.shapes.to_vec();
    for shape in shapes.iter_mut().filter(|shape| shape.iter().all(|v| *v == 0.0)) {
        shape.clear();
    }
    while shapes.pop_if(|shape| shape.is_empty()).is_some() {}

    // 3. Put together. Temperature is not named, as the design learns its effect by itself.
    let learned = causes.iter().filter(|id| **id != CauseId::Temperature);
    let extension = Extension {
        causes: learned.map(|id| id.to_string()).collect(),
        decay: model.decay().into(),
        follows,
        previous_tail: model.added.tail_gain,
        shapes,
    };
    let adds = !extension.follows.is_empty()
        || extension.previous_tail != 0.0
        || !extension.shapes.is_empty();
    adds.then_some(extension)
}

/// The least and the largest value of a covariate, in standard deviations from its mean; the mean
/// itself (0) always lies within.
fn range(beside: &Covariates, which: usize) -> [f64; 2] {
    beside.z.iter().fold([0.0_f64; 2], |[l, m], z| [l.min(z[which]), m.max(z[which])])
}
