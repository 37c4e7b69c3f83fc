//! Numbers that decide something and that nobody derived ("tuned" ones). A room that has any lists
//! them in one table (a file `tuned.rs`; of the state `process.rs`), by the macro
//! [`numbers!`](crate::numbers!).
//!
//! In: lines `name: type = value;` with a doc comment each. Out: a function `name()` per number, so
//! that one can measure what its half and its double would do (`docs/numbers.md`): in the tests of
//! this crate with `with`, in builds with the feature `ablation` also with the environment variable
//! `INKLING_NUMBER`. In any other build the function is as good as a constant.

/// The table of the numbers that several rooms use.
pub mod tuned {
    crate::numbers! {
        /// Fewest signals, channels or temperatures from which more than their mean is estimated; also
        /// the weight of a more general value.
        few: usize = 8;
        /// The share that counts as little of a whole, in thresholds, designs and the critique.
        little = 0.1;
        /// Least probability that a look is not what it seems, and least rate of false alarms (thrice
        /// the stated one) that the looks at a fault that comes and goes have to exceed.
        least_rate = 2e-3;
        /// Standard deviation of a guessed ln rate. With twice that a design without labelled faults
        /// names more on a head of another physics, but calls a stiffer actuator an air bubble in .24
        /// instead of .01 of its signals (seeds 2 and 1 of `tests/outside`).
        guessed_rate = 0.2;
    }
}

/// Makes a function of each number and, where numbers can be changed, the list `NUMBERS` of paths.
#[macro_export]
macro_rules! numbers {
    (@kind) => {
        f64
    };
    (@kind $kind:ty) => {
        $kind
    };
    ($($(#[$doc:meta])* $name:ident $(: $kind:ty)? = $value:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline]
            pub fn $name() -> $crate::numbers!(@kind $($kind)?) {
                let value: $crate::numbers!(@kind $($kind)?) = $value;
                $crate::numbers::as_it_is(concat!(module_path!(), "::", stringify!($name)), value)
            }
        )*

        #[cfg(any(test, feature = "ablation"))]
        pub const NUMBERS: &[&str] = &[$(concat!(module_path!(), "::", stringify!($name))),*];
    };
}

#[cfg(not(any(test, feature = "ablation")))]
#[inline]
pub fn as_it_is<T>(_path: &str, value: T) -> T {
    value
}

#[cfg(any(test, feature = "ablation"))]
pub use changed::{as_it_is, with};

#[cfg(any(test, feature = "ablation"))]
mod changed {
    use std::sync::{LazyLock, RwLock};

    /// The ends of the paths of the numbers that are changed now, with their factors. `INKLING_NUMBER`
    /// changes some for the whole process: `isolate::tuned::pulse_sd=2`, several with spaces between.
    static CHANGED: LazyLock<RwLock<Vec<(String, f64)>>> = LazyLock::new(|| {
        let asked = std::env::var("INKLING_NUMBER").unwrap_or_default();
        let number = |asked: &str| {
            let (path, times) = asked.split_once('=').expect("INKLING_NUMBER=table::name=times");
            (path.to_owned(), times.parse().expect("INKLING_NUMBER ends in a number"))
        };
        RwLock::new(asked.split_whitespace().map(number).collect())
    });

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

    /// The value of a number, multiplied by the first change whose path is the end of this one.
    pub fn as_it_is<T: Number>(path: &str, value: T) -> T {
        let changed = CHANGED.read().expect("nobody panics who holds it");
        match changed.iter().find(|(of, _)| path.ends_with(of)) {
            Some((_, times)) => value.times(*times),
            None => value,
        }
    }

    /// Runs something while a number is multiplied by a factor, on all threads. Runs may be nested but
    /// must not overlap.
    pub fn with<T>(path: &str, times: f64, run: impl FnOnce() -> T) -> T {
        let changed = || CHANGED.write().expect("nobody panics who holds it");
        changed().push((path.to_owned(), times));
        let result = run();
        changed().pop();
        result
    }
}

#[cfg(test)]
pub mod half_and_twice {
    /// Prints a table: what is measured with the numbers as they are, and with half and twice of each.
    pub fn print<const N: usize>(names: &[&str], measured: fn() -> [f64; N]) {
        let row = |name: &str, of: &[[f64; N]]| {
            let cell = |k: usize| {
                of.iter().map(|p| format!("{:.2}", p[k])).collect::<Vec<_>>().join(" / ")
            };
            println!("| {name} | {} |", (0..N).map(cell).collect::<Vec<_>>().join(" | "));
        };
        row("as it is", &[measured()]);
        for name in names {
            row(name, &[0.5, 2.0].map(|times| super::with(name, times, measured)));
        }
    }
}
