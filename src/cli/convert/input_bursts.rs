//! Opens a table or an array and reads its bursts.

use super::super::exit::Failure;
use super::args::Args;
use super::time_unit::TimeUnit;
use inkling_io::columnar::{self, Content, FileKind};
use inkling_io::matrix::Matrix;
use inkling_io::numpy;
use inkling_io::sampling::{self, Sampled};
use inkling_io::table_file::{self, Columns, Decay};

/// The bursts of a table or an array, and what is to be told about it.
pub struct InputBursts {
    pub matrices: Box<dyn Iterator<Item = Result<Matrix, Failure>>>,
    pub unit: TimeUnit,
    /// The sample period, s, if the table's own times give it.
    pub period_s: Option<f64>,
    /// Number of cells without a value that no interpolation fills.
    pub missing: usize,
    /// Names of the channels.
    pub outputs: Vec<String>,
    /// How regular the table's times are, if they are the times of samples.
    pub sampled: Option<Sampled>,
}

impl InputBursts {
    /// Opens a table or an array. `columns`: columns that are read beside the samples.
    pub fn open(args: &Args, kind: FileKind, columns: &[String]) -> Result<InputBursts, Failure> {
        match kind {
            FileKind::Numpy => open_array(args, columns),
            kind => open_table(args, kind, columns.to_vec()),
        }
    }

    /// Bursts of a file about which nothing else is to be told.
    fn new(
        matrices: impl Iterator<Item = Result<Matrix, Failure>> + 'static,
        unit: TimeUnit,
        outputs: Vec<String>,
    ) -> InputBursts {
        let matrices = Box::new(matrices);
        InputBursts { matrices, unit, period_s: None, missing: 0, outputs, sampled: None }
    }
}

/// Opens a table. Its rows are samples, or whole bursts if its cells are lists.
fn open_table(args: &Args, kind: FileKind, beside: Vec<String>) -> Result<InputBursts, Failure> {
    let columns = Columns {
        time: args.time.clone(),
        outputs: args.outputs.clone(),
        burst: args.burst.clone(),
        printhead: args.printhead.clone(),
        beside,
        rows_are_samples: args.period_s.is_some(),
    };
    let table = match kind {
        FileKind::Text => table_file::read(&args.table, &columns)?,
        kind => match columnar::read(&args.table, kind, &columns)? {
            Content::Rows(table) => table,
            Content::Bursts { time, outputs, matrices } => {
                if args.resample {
                    return Err(Failure::usage("--resample has no effect: each row is a burst"));
                }
                let first = matrices.iter().find_map(|matrix| matrix.time);
                let unit = time.map_or(TimeUnit::SECONDS, |time| TimeUnit::of(&time, first));
                return Ok(InputBursts::new(matrices.into_iter().map(Ok), unit, outputs));
            }
        },
    };
    let failed = |e: &dyn std::fmt::Display| Failure::new(format!("{}: {e}", args.table.display()));
    let first = table.decays.first().and_then(|decay| decay.times.first().copied());
    let unit = TimeUnit::of(&table.time, first.filter(|_| !table.time.is_empty()));
    let has_time = !table.time.is_empty() && args.every.is_none();
    let outputs = table.outputs.clone();
    // with --period-s rows are taken as they are listed; else the table's times give the period, and must be
    // regular
    let (period, mut sampled) = match args.period_s {
        Some(_) => (None, sampling::as_listed(table).map_err(|e| failed(&e))?),
        None => {
            let sampled = sampling::sample(table, args.resample).map_err(|e| failed(&e))?;
            (Some(sampled.period * unit.ns / 1e9), sampled)
        }
    };
    let matrix = |decay: Decay| {
        let samples = decay.times.len();
        let numbers = decay.outputs.iter().flatten().copied();
        let matrix = Matrix::of(decay.outputs.len(), samples, numbers);
        Ok(Matrix {
            time: decay.times.first().copied().filter(|_| has_time),
            printhead: Some(decay.printhead).filter(|name| !name.is_empty()),
            beside: decay.beside,
            ..matrix.ok_or_else(|| failed(&"a burst too large"))?
        })
    };
    let decays = std::mem::take(&mut sampled.decays);
    let matrices = decays.into_iter().map(matrix).collect::<Result<Vec<Matrix>, Failure>>()?;
    let missing = sampled.missing;
    Ok(InputBursts {
        period_s: period,
        missing: if args.resample { 0 } else { missing },
        sampled: period.is_some().then_some(sampled),
        ..InputBursts::new(matrices.into_iter().map(Ok), unit, outputs)
    })
}

/// Opens an array of NumPy. In a .npz further arrays may hold times and values, one number per burst.
fn open_array(args: &Args, beside: &[String]) -> Result<InputBursts, Failure> {
    if args.burst.is_some() || args.resample {
        return Err(Failure::usage("--burst and --resample are of tables, not of arrays"));
    }
    let name = match args.outputs.as_deref() {
        None => None,
        Some([one]) => Some(one.as_str()),
        Some(_) => return Err(Failure::usage("--outputs: one array of a .npz")),
    };
    let path = &args.table;
    let others: Vec<&str> = beside.iter().chain(&args.time).map(String::as_str).collect();
    let array = numpy::open(path, name, &others).map_err(Failure::new)?;
    let bursts = array.left;
    // the numbers of a further array, one per burst; `one_for_all`: a single number may stand for all bursts
    let numbers = |name: &str, one_for_all: bool| {
        let (all, unit_ns) = numpy::numbers(path, name).map_err(Failure::new)?;
        match (all.len(), one_for_all) {
            (1, true) => Ok((vec![all[0]; bursts], unit_ns)),
            (n, _) if n == bursts => Ok((all, unit_ns)),
            (n, _) => {
                let what = format!("array {name:?} has {n} numbers for {bursts} bursts");
                Err(Failure::new(format!("{}: {what}", path.display())))
            }
        }
    };
    let columns: Vec<Vec<f64>> =
        beside.iter().map(|name| Ok(numbers(name, true)?.0)).collect::<Result<_, Failure>>()?;
    let times = args.time.as_deref().map(|name| numbers(name, false)).transpose()?;
    let first = times.as_ref().and_then(|(times, _)| times.first().copied());
    let unit = match (&times, &args.time) {
        (Some((_, Some(unit_ns))), _) => TimeUnit { ns: *unit_ns as f64, by_size: None },
        (_, Some(name)) => TimeUnit::of(name, first),
        _ => TimeUnit::SECONDS,
    };
    let times = times.map(|(times, _)| times);
    let matrices = array.enumerate().map(move |(i, matrix)| {
        let matrix = matrix.map_err(Failure::new)?;
        let beside = columns.iter().map(|column| column[i]).collect();
        Ok(Matrix { time: times.as_ref().map(|times| times[i]), beside, ..matrix })
    });
    Ok(InputBursts::new(matrices, unit, Vec::new()))
}
