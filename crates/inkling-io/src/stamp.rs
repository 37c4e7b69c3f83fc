//! Size and time of change of a file or an object: by these two its content is recognised without reading it.
//!
//! The journal keeps the stamp of each input, so that a recording that has not changed is not judged again.

use serde::{Deserialize, Serialize};
use std::fs::Metadata;
use std::time::SystemTime;

/// What is compared; two inputs with equal stamps are taken for the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    pub bytes: u64,
    /// Last change, ns since 1970. `None`: the file system does not say, or it lies outside 1970 to 2262.
    pub modified_ns: Option<i64>,
}

impl Stamp {
    /// The stamp of a file of the file system.
    pub fn of(metadata: &Metadata) -> Stamp {
        let since_1970 = |t: SystemTime| t.duration_since(SystemTime::UNIX_EPOCH).ok();
        let modified_ns = metadata.modified().ok().and_then(since_1970);
        Stamp {
            bytes: metadata.len(),
            modified_ns: modified_ns.and_then(|d| i64::try_from(d.as_nanos()).ok()),
        }
    }
}
