//! The stamp of a file or an object: its size and time of change, by which its content is
//! recognised without reading it.

use serde::{Deserialize, Serialize};
use std::fs::Metadata;
use std::time::SystemTime;

/// Two inputs at the same path with equal stamps are taken for the same content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    pub bytes: u64,
    /// Last change, ns since 1970. `None`: the file system does not say, or it lies outside 1970 to 2262.
    pub modified_ns: Option<i64>,
}

impl Stamp {
    pub fn of(metadata: &Metadata) -> Stamp {
        let since_1970 = |t: SystemTime| t.duration_since(SystemTime::UNIX_EPOCH).ok();
        let modified_ns = metadata.modified().ok().and_then(since_1970);
        Stamp {
            bytes: metadata.len(),
            modified_ns: modified_ns.and_then(|d| i64::try_from(d.as_nanos()).ok()),
        }
    }
}
