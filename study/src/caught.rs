//! Work whose panic is an error like any other.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Does a piece of work; a panic in it is an error that says so. One task of thousands, or one file, must not end the work on all others.
///
/// The work must leave nothing behind that others see half done: what it makes is dropped.
///
/// # Errors
/// The panic's message.
///
/// ```
/// assert_eq!(sunglint_study::caught(|| 1 + 1), Ok(2));
/// ```
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|reason| {
        let text = reason.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| reason.downcast_ref::<&str>().copied());
        let text = text.unwrap_or("without a message");
        format!("the program failed ({text}); this is a fault of sunglint, please report it")
    })
}
