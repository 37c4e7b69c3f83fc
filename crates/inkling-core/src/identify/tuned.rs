//! All numbers of identification that nobody derived; docs/numbers.md tells what half and twice of each do.

crate::numbers! {
    /// A model whose misfit exceeds that of the best damped cosine of a coarse grid by this factor has not
    /// found the ring.
    worse = 1.5;
    /// Standard deviation of the prior on ln (a / b) about the guess. An average often does not determine the
    /// real pole; without a prior the search would then wander along a flat valley of the cost. Where the
    /// data determine it, the prior is negligible.
    prior_sd = 1.0;
    /// Smallest number of signals at each temperature that is told apart.
    fewest_at_a_temperature: usize = 64;
    /// A smaller span of temperatures than this tells nothing but noise, K.
    least_span_k = 2.0;
    /// Largest standard deviation of the ln of a ratio of rates that counts as known.
    least_known = 0.5;
    /// Smallest standard deviation of the temperatures from which a response is learned, K.
    least_spread_k = 0.2;
}
