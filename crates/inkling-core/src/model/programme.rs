//! Convex quadratic and linear programmes, by Clarabel's interior-point method.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

/// The x that minimises 1/2 x'Px + q'x such that no component of A x exceeds that of b, and whether it is as
/// accurate as it should be. `p`: P's upper triangle by rows, empty for a linear programme; `a`: A by rows.
/// `None`: Clarabel refuses the programme.
pub fn minimise(p: &[Vec<f64>], q: &[f64], a: &[Vec<f64>], b: &[f64]) -> Option<(Vec<f64>, bool)> {
    let p = match p.is_empty() {
        true => CscMatrix::zeros((q.len(), q.len())),
        false => CscMatrix::from(p),
    };
    let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
    let cones = [SupportedConeT::NonnegativeConeT(b.len())];
    let mut solver = DefaultSolver::new(&p, q, &CscMatrix::from(a), b, &cones, settings).ok()?;
    solver.solve();
    let solution = solver.solution;
    let is_solved = matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    Some((solution.x, is_solved))
}
