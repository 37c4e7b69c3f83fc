//! The numbers of identification that nobody derived, all of them; docs/numbers.md tells what half and twice of each do.

crate::numbers! {
    /// A model whose misfit exceeds that of the best damped cosine of a coarse grid by this factor has not found the ring.
    worse = 1.5;
    /// Standard deviation of the prior on ln (a / b) about the guess. An average often does not determine the real pole; without a prior
    /// the search would then wander along a flat valley of the cost. Where the data determine it, the prior is negligible.
    prior_sd = 1.0;
    /// Signals of each temperature that is told apart, at least.
    fewest_at_a_temperature: usize = 64;
    /// What less of a span of temperatures tells is noise, K.
    least_span_k = 2.0;
    /// Rates that are known no better than by this factor are not known.
    least_known = 0.5;
    /// Temperatures that scatter by less tell no response, K.
    least_spread_k = 0.2;
    /// Temperatures that a response is learned from, at least.
    least_temperatures: usize = 8;
    /// Channels that tell how healthy ones differ, at least.
    fewest_channels: usize = 8;
}
