//! Names out of a file, for the parts of this crate in which names live as long as the program.

use std::collections::HashSet;
use std::sync::{Mutex, PoisonError};

/// Names of settings with what they take.
pub(super) type Takes = &'static [(&'static str, &'static str)];

static KEPT: Mutex<Option<HashSet<&'static str>>> = Mutex::new(None);
static LISTS: Mutex<Vec<Takes>> = Mutex::new(Vec::new());

/// One copy of a text, kept until the program ends. A file holds few and short ones, and a file that is read again needs no new ones.
pub(super) fn kept(text: &str) -> &'static str {
    let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let all = all.get_or_insert_default();
    match all.get(text) {
        Some(known) => known,
        None => {
            let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
            all.insert(text);
            text
        }
    }
}

/// One copy of a list, kept until the program ends.
pub(super) fn kept_list(list: &[(&'static str, &'static str)]) -> Takes {
    let mut all = LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = all.iter().find(|known| **known == list) {
        return known;
    }
    let list: Takes = Box::leak(list.to_vec().into_boxed_slice());
    all.push(list);
    list
}
