//! Convex quadratic and linear programmes, by Clarabel's interior-point method: but for tests the
//! only file that knows Clarabel. The bounded step of (3-1) (`identify/rate_search.rs`) and the
//! linear programme of the filter's numerator (`detect/linear_programme.rs`) are solved by it.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

/// The x that minimises 1/2 x'Px + q'x such that no component of A x exceeds that of b, and whether
/// Clarabel calls it solved; if not, x is where the iteration stopped, and may be far off.
///
/// `p`: the rows of P, symmetric and n x n, of which only the upper triangle may hold other numbers
/// than 0; no rows at all for a linear programme. `q`: n. `a`: the rows of A, m x n. `b`: m.
/// `None`: Clarabel refuses the programme, as where the sizes do not fit.
pub fn minimise(p: &[Vec<f64>], q: &[f64], a: &[Vec<f64>], b: &[f64]) -> Option<(Vec<f64>, bool)> {
    let p = match p.is_empty() {
        true => CscMatrix::zeros((q.len(), q.len())),
        false => CscMatrix::from(p),
    };

    // A x + slack = b with a slack that is not negative is how Clarabel writes A x <= b
    let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
    let cones = [SupportedConeT::NonnegativeConeT(b.len())];
    let mut solver = DefaultSolver::new(&p, q, &CscMatrix::from(a), b, &cones, settings).ok()?;
    solver.solve();
    let solution = solver.solution;
    let is_solved = matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    Some((solution.x, is_solved))
}
