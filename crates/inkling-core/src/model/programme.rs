//! Convex quadratic and linear programmes, by Clarabel's interior-point method: the only file but
//! for tests that knows Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

/// The x that minimises 1/2 x'Px + q'x such that A x <= b, and whether Clarabel calls it solved; if
/// not, x may be far off. `p`: the upper triangle of P by rows of n, with zeros below; no rows for
/// a linear programme. `a`: the rows of A, m x n. `None`: the sizes do not fit.
pub fn minimise(p: &[Vec<f64>], q: &[f64], a: &[Vec<f64>], b: &[f64]) -> Option<(Vec<f64>, bool)> {
    let p = match p.is_empty() {
        true => CscMatrix::zeros((q.len(), q.len())),
        false => CscMatrix::from(p),
    };

    // A x + slack = b, slack >= 0
    let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
    let cones = [SupportedConeT::NonnegativeConeT(b.len())];
    let mut solver = DefaultSolver::new(&p, q, &CscMatrix::from(a), b, &cones, settings).ok()?;
    solver.solve();
    let solution = solver.solution;
    let is_solved = matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    Some((solution.x, is_solved))
}
