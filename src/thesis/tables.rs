//! What the thesis reports: its tables, and which of our figures stands beside each number.

/// A row: what it says, our figure's name, the thesis's number.
pub type Row = (&'static str, &'static str, Option<f64>);

pub struct Table {
    pub title: &'static str,
    pub rows: &'static [Row],
    pub confusion: Option<Published>,
}

/// A confusion matrix of the thesis. Rows: truth.
pub struct Published {
    /// The name of ours.
    pub ours: &'static str,
    pub classes: &'static [&'static str],
    pub counts: &'static [&'static [u32]],
}

const fn table(title: &'static str, rows: &'static [Row]) -> Table {
    Table { title, rows, confusion: None }
}

const DETECTION: &[&str] = &["healthy", "faulty"];

/// Thesis Table 4-1. 2475 healthy and 2025 faulty test signals.
const TABLE_4_1: &[&[u32]] = &[&[2474, 1], &[92, 1933]];

/// Thesis Table 4-2. 48 and 99.
const TABLE_4_2: &[&[u32]] = &[&[48, 0], &[0, 99]];

/// Thesis Table 4-3. 225 of each class.
const TABLE_4_3: &[&[u32]] = &[
    &[154, 0, 0, 0, 0, 0, 27, 0, 44],
    &[0, 173, 0, 0, 6, 0, 46, 0, 0],
    &[0, 0, 222, 2, 1, 0, 0, 0, 0],
    &[0, 0, 0, 225, 0, 0, 0, 0, 0],
    &[0, 0, 0, 0, 225, 0, 0, 0, 0],
    &[0, 1, 0, 0, 0, 172, 52, 0, 0],
    &[0, 0, 0, 0, 0, 0, 225, 0, 0],
    &[0, 0, 0, 0, 0, 99, 117, 9, 0],
    &[0, 0, 0, 0, 0, 0, 0, 8, 217],
];

/// Thesis Table 4-4.
const TABLE_4_4: &[&[u32]] = &[
    &[125, 0, 0, 0, 0, 0, 0, 0, 0],
    &[0, 81, 0, 0, 0, 0, 16, 0, 0],
    &[0, 0, 146, 0, 0, 0, 0, 0, 0],
    &[0, 0, 0, 133, 0, 0, 0, 0, 0],
    &[0, 0, 0, 0, 221, 0, 0, 0, 0],
    &[0, 0, 0, 0, 0, 16, 0, 0, 0],
    &[0, 0, 0, 0, 0, 0, 163, 0, 0],
    &[0, 0, 0, 0, 0, 52, 62, 0, 0],
    &[0, 0, 0, 0, 0, 0, 0, 0, 63],
];

/// Thesis Table 4-5. IDN, DDN: 39 and 60.
const TABLE_4_5: &[&[u32]] = &[&[38, 1], &[0, 60]];

pub const TABLES: [Table; 13] = [
    Table {
        title: "Table 4-1: detection, simulated data (mu = 1)",
        rows: &[
            ("misses of 2025, n_o = 7.25", "FD n_o = 7.25/misses", Some(92.0)),
            ("of them SDN", "FD n_o = 7.25/misses of SDN", Some(83.0)),
            ("of them IDN", "FD n_o = 7.25/misses of IDN", Some(9.0)),
            ("false alarms of 2475", "FD n_o = 7.25/false alarms", Some(1.0)),
            ("share right", "FD n_o = 7.25/accuracy", Some(0.979)),
            ("misses, n_o = f0 T (our default)", "FD n_o = f0 T/misses", None),
            ("false alarms, n_o = f0 T", "FD n_o = f0 T/false alarms", None),
        ],
        confusion: Some(Published { ours: "FD n_o = 7.25", classes: DETECTION, counts: TABLE_4_1 }),
    },
    table(
        "Denominators of §3-2-1 compared (largest healthy training energy as threshold)",
        &[
            ("I, n_o = f0 T: misses", "FD n_o = f0 T/misses", None),
            ("I, n_o = f0 T, degree 3: misses", "FD n_o = f0 T, degree 3/misses", None),
            ("II, eigenvalues of SDN: misses", "FD II/misses", None),
            ("III, numerator enhanced on SDN: misses", "FD III/misses", None),
            (
                "(3-3b), the numerator of degree 4 that shows SDN most: misses",
                "FD (3-3b)/misses",
                None,
            ),
            ("searched on training data: misses", "search/misses", None),
            ("I, n_o = f0 T: false alarms", "FD n_o = f0 T/false alarms", None),
            ("II: false alarms", "FD II/false alarms", None),
            ("III: false alarms", "FD III/false alarms", None),
            ("(3-3b): false alarms", "FD (3-3b)/false alarms", None),
            ("searched: false alarms", "search/false alarms", None),
            (
                "n_o = 7.25, the residual's maximum for its energy: misses",
                "FD maximum/misses",
                None,
            ),
            ("n_o = 7.25, maximum: false alarms", "FD maximum/false alarms", None),
            ("I with the quantile threshold: misses", "FD quantile/misses", None),
            ("I with the quantile threshold: false alarms", "FD quantile/false alarms", None),
        ],
    ),
    table(
        "The search for a denominator (misses at 1 false alarm in 1000, five-fold on training data)",
        &[
            ("misses, chosen on the other folds", "search/cross-validated misses", None),
            ("misses, method I", "search/cross-validated misses of method I", None),
            ("chosen frequency over f0", "search/frequency over f0", None),
            ("chosen damping of the pair, 1/s", "search/damping, 1/s", None),
            ("chosen other poles, 1/s", "search/other poles, 1/s", None),
        ],
    ),
    Table {
        title: "Table 4-3: isolation by linear regression on r, every faulty signal",
        rows: &[
            ("accuracy", "LR on r, 2025/accuracy", Some(0.801)),
            ("accuracy of what passed the gate", "LR on r, 2025 gated/accuracy", None),
        ],
        confusion: Some(Published {
            ours: "LR on r, 2025",
            classes: &crate::fault::CLASSES,
            counts: TABLE_4_3,
        }),
    },
    Table {
        title: "Table 4-4: the same where phi >= 0.8",
        rows: &[
            ("accuracy", "LR on r, 2025/certain", Some(0.879)),
            ("share isolated", "LR on r, 2025/coverage", Some(0.532)),
            ("HMA without IDN", "LR on r, 2025 certain/HMA without IDN", Some(0.983)),
            (
                "HMA, SDN and IDN as one (theirs of the matrix below)",
                "LR on r, 2025 certain/HMA, SDN and IDN as one",
                Some(0.937),
            ),
            ("accuracy, gated", "LR on r, 2025 gated/certain", None),
            ("share isolated, gated", "LR on r, 2025 gated/coverage", None),
        ],
        confusion: Some(Published {
            ours: "LR on r, 2025 certain",
            classes: &crate::fault::CLASSES,
            counts: TABLE_4_4,
        }),
    },
    table(
        "Table 4-6: methods and training sizes, every faulty signal",
        &[
            ("2025, r: LR", "LR on r, 2025/accuracy", Some(0.801)),
            ("2025, r: LR, phi >= 0.8", "LR on r, 2025/certain", Some(0.879)),
            ("2025, r: 1-NN", "1-NN on r, 2025/accuracy", Some(0.816)),
            ("2025, y: LR", "LR on y, 2025/accuracy", Some(0.763)),
            ("2025, y: LR, phi >= 0.8", "LR on y, 2025/certain", Some(0.881)),
            ("2025, y: 1-NN", "1-NN on y, 2025/accuracy", Some(0.815)),
            ("1013, r: LR", "LR on r, 1013/accuracy", Some(0.797)),
            ("1013, r: LR, phi >= 0.8", "LR on r, 1013/certain", Some(0.879)),
            ("1013, r: 1-NN", "1-NN on r, 1013/accuracy", Some(0.815)),
            ("1013, y: LR", "LR on y, 1013/accuracy", Some(0.768)),
            ("1013, y: LR, phi >= 0.8", "LR on y, 1013/certain", Some(0.875)),
            ("1013, y: 1-NN", "1-NN on y, 1013/accuracy", Some(0.782)),
            ("203, r: LR", "LR on r, 203/accuracy", Some(0.772)),
            ("203, r: LR, phi >= 0.8", "LR on r, 203/certain", Some(0.867)),
            ("203, r: 1-NN", "1-NN on r, 203/accuracy", Some(0.767)),
            ("203, y: LR", "LR on y, 203/accuracy", Some(0.661)),
            ("203, y: LR, phi >= 0.8", "LR on y, 203/certain", Some(0.820)),
            ("203, y: 1-NN", "1-NN on y, 203/accuracy", Some(0.729)),
        ],
    ),
    table(
        "Gated: isolation of what passed the detection of Table 4-1",
        &[
            ("2025, r: LR", "LR on r, 2025 gated/accuracy", None),
            ("2025, r: LR, phi >= 0.8", "LR on r, 2025 gated/certain", None),
            ("2025, r: 1-NN", "1-NN on r, 2025 gated/accuracy", None),
            ("2025, y: LR", "LR on y, 2025 gated/accuracy", None),
            ("2025, y: 1-NN", "1-NN on y, 2025 gated/accuracy", None),
        ],
    ),
    table(
        "Model matching (§3-3-1, no table in the thesis)",
        &[
            ("fault classes with a model of their own", "models of faults", None),
            ("accuracy of what fits a class", "model matching/accuracy", None),
            ("right of all faulty signals", "model matching/of all", None),
            ("rejected: fits no class", "model matching/rejected", None),
            ("accuracy of what fits a class, gated", "model matching gated/accuracy", None),
        ],
    ),
    table(
        "The current practice: frequency and damping by Fourier transform, thresholds per class",
        &[
            ("detection: share right", "practice/detection", Some(0.948)),
            ("misses of 2025", "practice/misses", None),
            ("false alarms of 2475", "practice/false alarms", None),
            (
                "isolation, the four classes it knows: right of all",
                "practice/four classes",
                Some(0.413),
            ),
            ("right of the four classes", "practice/of the four", Some(0.930)),
            ("isolation, extended to nine classes", "practice/nine classes", None),
        ],
    ),
    Table {
        title: "Table 4-2: detection in the drying experiment (ours simulated; mu = 2)",
        rows: &[
            ("detected of 99", "FD drying/tp", Some(99.0)),
            ("false alarms of 48", "FD drying/false alarms", Some(0.0)),
            ("current practice: detection", "drying: practice/detection", Some(0.918)),
        ],
        confusion: Some(Published { ours: "FD drying", classes: DETECTION, counts: TABLE_4_2 }),
    },
    Table {
        title: "Table 4-5: isolation in the drying experiment, all 99 faulty signals (39 IDN, 60 DDN)",
        rows: &[
            ("HMA", "drying: LR on r, 147/accuracy", Some(0.990)),
            ("current practice: isolation", "drying: practice/isolation", Some(0.883)),
        ],
        confusion: Some(Published {
            ours: "drying: LR on r, 147",
            classes: &["IDN", "DDN"],
            counts: TABLE_4_5,
        }),
    },
    table(
        "Table 4-7: methods and training sizes on the drying experiment (147: 48 healthy, 39 IDN, 60 DDN)",
        &[
            ("147, r: LR", "drying: LR on r, 147/accuracy", Some(0.990)),
            ("147, r: LR, phi >= 0.8", "drying: LR on r, 147/certain", Some(1.0)),
            ("147, r: 1-NN", "drying: 1-NN on r, 147/accuracy", Some(0.990)),
            ("147, y: LR", "drying: LR on y, 147/accuracy", Some(0.980)),
            ("147, y: LR, phi >= 0.8", "drying: LR on y, 147/certain", Some(1.0)),
            ("147, y: 1-NN", "drying: 1-NN on y, 147/accuracy", Some(0.980)),
            ("74, r: LR", "drying: LR on r, 74/accuracy", Some(1.0)),
            ("74, r: LR, phi >= 0.8", "drying: LR on r, 74/certain", Some(1.0)),
            ("74, r: 1-NN", "drying: 1-NN on r, 74/accuracy", Some(1.0)),
            ("74, y: LR", "drying: LR on y, 74/accuracy", Some(0.980)),
            ("74, y: LR, phi >= 0.8", "drying: LR on y, 74/certain", Some(1.0)),
            ("74, y: 1-NN", "drying: 1-NN on y, 74/accuracy", Some(0.980)),
            ("15, r: LR", "drying: LR on r, 15/accuracy", Some(0.990)),
            ("15, r: LR, phi >= 0.8", "drying: LR on r, 15/certain", Some(1.0)),
            ("15, r: 1-NN", "drying: 1-NN on r, 15/accuracy", Some(0.990)),
            ("15, y: LR", "drying: LR on y, 15/accuracy", Some(0.980)),
            ("15, y: LR, phi >= 0.8", "drying: LR on y, 15/certain", Some(1.0)),
            ("15, y: 1-NN", "drying: 1-NN on y, 15/accuracy", Some(0.980)),
        ],
    ),
    table(
        "The default methods: sensitivities and posterior",
        &[
            ("FD misses of 2025", "FD default/misses", None),
            ("FD false alarms of 2475", "FD default/false alarms", None),
            ("FD share right", "FD default/accuracy", None),
            ("2025 training signals: FI accuracy", "posterior, 2025/accuracy", None),
            ("2025: accuracy where the certainty is >= .8", "posterior, 2025/certain", None),
            ("2025: share of them", "posterior, 2025/coverage", None),
            ("2025: accuracy of the best 53.2 %", "posterior, 2025/best 53.2 %", None),
            ("2025: ECE top-label, 20 007 signals", "posterior, 2025/ECE", None),
            ("2025: ECE class-wise", "posterior, 2025/class-wise ECE", None),
            ("1013 training signals: FI accuracy", "posterior, 1013/accuracy", None),
            ("1013: accuracy where the certainty is >= .8", "posterior, 1013/certain", None),
            ("1013: share of them", "posterior, 1013/coverage", None),
            ("1013: accuracy of the best 53.2 %", "posterior, 1013/best 53.2 %", None),
            ("1013: ECE top-label, 20 007 signals", "posterior, 1013/ECE", None),
            ("1013: ECE class-wise", "posterior, 1013/class-wise ECE", None),
            ("203 training signals: FI accuracy", "posterior, 203/accuracy", None),
            ("203: accuracy where the certainty is >= .8", "posterior, 203/certain", None),
            ("203: share of them", "posterior, 203/coverage", None),
            ("203: accuracy of the best 53.2 %", "posterior, 203/best 53.2 %", None),
            ("203: ECE top-label, 20 007 signals", "posterior, 203/ECE", None),
            ("203: ECE class-wise", "posterior, 203/class-wise ECE", None),
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thesis::Confusion;

    fn published(table: &Published) -> Confusion {
        let counts = table.counts.iter().map(|row| row.iter().map(|&n| f64::from(n)).collect());
        let classes = table.classes.iter().map(|c| (*c).to_owned()).collect();
        Confusion { classes, counts: counts.collect() }
    }

    fn matrix(title: &str) -> Confusion {
        let table = TABLES.iter().find(|table| table.title.starts_with(title)).unwrap();
        published(table.confusion.as_ref().unwrap())
    }

    /// What the text of thesis chapter 4 says of its own matrices.
    #[test]
    fn the_published_matrices_give_the_published_shares_and_sizes() {
        for (title, share, signals) in [
            ("Table 4-1", 0.979, 4500.0),
            ("Table 4-2", 1.0, 147.0),
            ("Table 4-3", 0.801, 2025.0),
            ("Table 4-4", 0.879, 0.532 * 2025.0),
            ("Table 4-5", 0.990, 99.0),
        ] {
            let matrix = matrix(title);
            assert!((matrix.hma() - share).abs() < 6e-4, "{title}: {}", matrix.hma());
            let sum: f64 = matrix.counts.iter().flatten().sum();
            assert!((sum - signals).abs() < 1.0, "{title}: {sum} signals");
        }
        let certain = matrix("Table 4-4");
        assert!((certain.without("IDN").hma() - 0.983).abs() < 6e-4);
        let merged = certain.merged("SDN", "IDN");
        assert!((merged.hma() - 0.937).abs() < 6e-4, "{}", merged.hma());
        assert_eq!(merged.classes.len(), 8);
        let all = |c: &Confusion| c.counts.iter().flatten().sum::<f64>();
        assert_eq!(all(&merged), all(&certain));
    }
}
