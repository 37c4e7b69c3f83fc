//! Reads and writes object stores: whatever the program reads or writes may have a name such as
//! `gs://bucket/key` or `az://container/key` instead of a path of the file system.
//!
//! ```text
//! store     which server a name means and which credentials open it; errors in words
//! object    one object, read by ranges ahead of whoever reads
//! transfer  whole objects: listed, fetched, sent, removed, renamed
//! absent    the same functions in a build without object stores: each of them fails
//! ```
//!
//! A recording is read where it lies ([`Object`]), because it may be larger than the disk.
//! Everything else that is read is fetched into a temporary file first ([`fetch`]). A result is
//! written to a temporary file and sent when it is complete ([`send`]), so that an object appears
//! by the last request or not at all. No credential ever stands in a message. Without the feature
//! `object-store` every function fails with an error that names the feature.

use std::path::Path;

#[cfg(not(feature = "object-store"))]
mod absent;
#[cfg(feature = "object-store")]
mod object;
#[cfg(feature = "object-store")]
mod store;
#[cfg(feature = "object-store")]
mod transfer;

#[cfg(not(feature = "object-store"))]
pub use absent::*;
#[cfg(feature = "object-store")]
pub use object::Object;
#[cfg(feature = "object-store")]
pub use store::check;
#[cfg(feature = "object-store")]
pub use transfer::{fetch, list, remove, rename, send, stamp, temporary};

/// `abfs` and `abfss` belong to Azure: they count as names in a store so that opening them can say
/// how to write them.
pub fn in_object_store(path: &Path) -> bool {
    let text = path.to_string_lossy();
    ["s3://", "s3a://", "gs://", "az://", "abfs://", "abfss://"]
        .iter()
        .any(|of| text.starts_with(of))
}
