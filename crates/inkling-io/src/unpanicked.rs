//! Calls libraries that panic where they should return an error for a damaged file, and turns the
//! panic into `None`. The readers of Parquet, Arrow and protobuf schemas are called this way.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

/// `None` if `read` panics; nothing is printed of such a panic, since the caller makes an error of
/// it. Calls must not be nested: the inner call would make the outer one's panics be printed again.
pub fn unpanicked<T>(read: impl FnOnce() -> T) -> Option<T> {
    thread_local! {
        /// Whether panics of this thread are expected.
        static QUIET: Cell<bool> = const { Cell::new(false) };
    }
    /// The hook is installed once for the process, and looks at the flag of the panicking thread.
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let print = take_hook();
        set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                print(panic);
            }
        }));
    });
    QUIET.set(true);
    let read = catch_unwind(AssertUnwindSafe(read));
    QUIET.set(false);
    read.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_none_and_what_comes_after_it_is_read() {
        assert_eq!(unpanicked(|| [1, 2][std::hint::black_box(2)]), None);
        assert_eq!(unpanicked(|| 3), Some(3));
    }
}
