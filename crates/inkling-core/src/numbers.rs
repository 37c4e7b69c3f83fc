//! Numbers that decide something and that nobody derived ("tuned" ones). A room that has any lists
//! them in one table (a file `tuned.rs`; of the state `process.rs`), by the macro
//! [`numbers!`](crate::numbers!).
//!
//! In: lines `name: type = value;` with a doc comment each. Out: a function `name()` per number,
//! which returns the value. A number is a function and no constant, so that one can measure what
//! its half and its double would do (`docs/numbers.md`): in the tests of this crate with `with`, in
//! builds with the feature `ablation` also with the environment variable `INKLING_NUMBER`. No other
//! build can change a number; there the function is as good as a constant.

/// The table of the numbers that several rooms use.
pub mod tuned {
    crate::numbers! {
        /// Fewest signals, channels, temperatures or labelled severities from which anything is
        /// estimated that needs more than their mean. With fewer, a more general value (of all
        /// classes, of the physics) is used instead. Also the weight of such a prior, in examples.
        few: usize = 8;
        /// A tenth: the share that counts as little of a whole wherever the code asks so. In detection, the
        /// largest of the healthy signals that count as their tail, and what the test on the misfit may have of
        /// the allowed false alarms. In designs, what a class of the physics may take of a user's own class. In
        /// the critique, signals that may lack a covariate, be left out, or be outliers of a channel; what a
        /// cause may leave to others of its kind; and how near a line may lie to a multiple of the ring.
        little = 0.1;
        /// Least probability that a look is not what it seems: that it says nothing of the class of its fault,
        /// or leaves more beside its ring than what is learned of its class allows. It is also the least rate of
        /// false alarms (thrice what is stated by default) that the looks at a fault that comes and goes have to
        /// exceed.
        least_rate = 2e-3;
        /// Standard deviation of a guessed ln rate: guesses are believed to within a fifth. With twice
        /// that a design without labelled faults names more on a head of another physics, and more of
        /// it rightly (seed 2 of `tests/outside`: .50 instead of .34 named at .8, .74 instead of .61 of
        /// these right), but calls a stiffer actuator an air bubble in .24 instead of .01 of its
        /// signals (seed 1). A ratio of two rates counts as known where it is better known than two guesses
        /// tell.
        guessed_rate = 0.2;
    }
}

/// Makes a function of each number of a table, under the number's name. Where numbers can be
/// changed the macro also makes the list `NUMBERS` of their paths, such as
/// `pulse_sd` among those of isolation.
#[macro_export]
macro_rules! numbers {
    // the type of a number: f64 where its line says nothing else
    (@kind) => {
        f64
    };
    (@kind $kind:ty) => {
        $kind
    };
    ($($(#[$doc:meta])* $name:ident $(: $kind:ty)? = $value:expr;)*) => {
        // the functions
        $(
            $(#[$doc])*
            #[inline]
            pub fn $name() -> $crate::numbers!(@kind $($kind)?) {
                let value: $crate::numbers!(@kind $($kind)?) = $value;
                $crate::numbers::as_it_is(concat!(module_path!(), "::", stringify!($name)), value)
            }
        )*

        // the list of paths
        #[cfg(any(test, feature = "ablation"))]
        pub const NUMBERS: &[&str] = &[$(concat!(module_path!(), "::", stringify!($name))),*];
    };
}

/// The value of a number, as it is: in this build it cannot be changed.
#[cfg(not(any(test, feature = "ablation")))]
#[inline]
pub fn as_it_is<T>(_path: &str, value: T) -> T {
    value
}

#[cfg(any(test, feature = "ablation"))]
pub use changed::{as_it_is, with};

/// The numbers of builds in which they can be changed.
#[cfg(any(test, feature = "ablation"))]
mod changed {
    use std::sync::{LazyLock, RwLock};

    /// The numbers that are changed now: the end of each one's path, and the factor. The
    /// environment variable `INKLING_NUMBER` changes some for the whole process:
    /// `isolate::tuned::pulse_sd=2`, or several of these with spaces between them. A variable that
    /// cannot be read ends the process.
    static CHANGED: LazyLock<RwLock<Vec<(String, f64)>>> = LazyLock::new(|| {
        let asked = std::env::var("INKLING_NUMBER").unwrap_or_default();
        let number = |asked: &str| {
            let (path, times) = asked.split_once('=').expect("INKLING_NUMBER=table::name=times");
            (path.to_owned(), times.parse().expect("INKLING_NUMBER ends in a number"))
        };
        RwLock::new(asked.split_whitespace().map(number).collect())
    });

    /// The types that a table's numbers may have.
    pub trait Number {
        /// The number multiplied by a factor; of an array every element, and a count is rounded.
        fn times(self, by: f64) -> Self;
    }

    impl Number for f64 {
        fn times(self, by: f64) -> f64 {
            self * by
        }
    }

    impl Number for f32 {
        fn times(self, by: f64) -> f32 {
            (f64::from(self) * by) as f32
        }
    }

    impl Number for usize {
        fn times(self, by: f64) -> usize {
            (self as f64 * by).round() as usize
        }
    }

    impl<const N: usize> Number for [f64; N] {
        fn times(self, by: f64) -> [f64; N] {
            self.map(|v| v * by)
        }
    }

    /// The value of a number, multiplied if [`with`] or the environment says so. `path`: the
    /// number's path; the first change whose path is the end of this one counts, and changes do not
    /// add up.
    pub fn as_it_is<T: Number>(path: &str, value: T) -> T {
        let changed = CHANGED.read().expect("nobody panics who holds it");
        match changed.iter().find(|(of, _)| path.ends_with(of)) {
            Some((_, times)) => value.times(*times),
            None => value,
        }
    }

    /// Runs something while a number is multiplied by a factor, on all threads, and returns the
    /// result of `run`. Runs may be nested but must not overlap on two threads, since the change
    /// that was added last is removed at the end. After a panic in `run` the change stays.
    pub fn with<T>(path: &str, times: f64, run: impl FnOnce() -> T) -> T {
        let changed = || CHANGED.write().expect("nobody panics who holds it");
        changed().push((path.to_owned(), times));
        let result = run();
        changed().pop();
        result
    }
}
