//! Numbers that decide and that nobody derived. A room that has any lists them in one table, by
//! [`numbers!`](crate::numbers!).
//!
//! Each number is a function, so that one can ask what its half and twice do: by `with`, which exists in the
//! tests of this crate and in builds with the feature `ablation`. No other build can change a number.

/// The numbers that several rooms use.
pub mod tuned {
    crate::numbers! {
        /// Fewest signals, channels, temperatures or labelled severities from which anything is estimated that
        /// needs more than their mean. With fewer, what is more general is used in its place.
        few: usize = 8;
        /// A tenth, which is little of a whole.
        little = 0.1;
        /// Least probability that a look is not what it seems: that it says nothing of the class of its fault,
        /// or leaves more beside its ring than what is learned of its class allows. It is also the least rate of
        /// false alarms (thrice what is stated by default) that the looks at a fault that comes and goes have to
        /// exceed.
        least_rate = 2e-3;
    }
}

/// Makes a function of each number of a table, under its name, and a list of all paths where they can be
/// changed.
#[macro_export]
macro_rules! numbers {
    // the type of a number, f64 where its row says nothing else
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

/// The value of a number, which cannot be changed in this build.
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

    /// The numbers that are changed, by the ends of their paths, and by which factors. The environment variable
    /// `INKLING_NUMBER` changes some for the whole process: `isolate::tuned::gain=2`, or several of these with
    /// spaces between them.
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
        /// The number multiplied by a factor.
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

    /// The value of a number, changed if [`with`] or the environment says so.
    pub fn as_it_is<T: Number>(path: &str, value: T) -> T {
        let changed = CHANGED.read().expect("nobody panics who holds it");
        match changed.iter().find(|(of, _)| path.ends_with(of)) {
            Some((_, times)) => value.times(*times),
            None => value,
        }
    }

    /// Runs something while a number is multiplied by a factor, on all threads, and returns the result.
    pub fn with<T>(path: &str, times: f64, run: impl FnOnce() -> T) -> T {
        let changed = || CHANGED.write().expect("nobody panics who holds it");
        changed().push((path.to_owned(), times));
        let result = run();
        changed().pop();
        result
    }
}
