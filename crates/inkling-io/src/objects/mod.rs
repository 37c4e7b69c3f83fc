//! Object stores: `s3://bucket/key`, `gs://bucket/key`, `az://container/key`.
//!
//! ```text
//! store    which store, by whose credentials; errors in words
//! object   read by ranges, ahead of whoever reads
//! ```
//!
//! A recording is read where it lies ([`Object`]). Whatever else is read is fetched into a temporary file first
//! ([`fetch`]), and results are written to one and sent when they are complete ([`send`]): an object appears by the
//! last request, or not at all. No credential is ever in a message. Without the feature `object-store` every
//! function says so.

use std::path::Path;

#[cfg(not(feature = "object-store"))]
mod absent;
#[cfg(feature = "object-store")]
mod object;
#[cfg(feature = "object-store")]
mod profile;
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

/// Whether a name is that of something in an object store: `s3://bucket/key`.
pub fn in_object_store(path: &Path) -> bool {
    let text = path.to_string_lossy();
    ["s3://", "s3a://", "gs://", "az://", "abfs://", "abfss://"]
        .iter()
        .any(|of| text.starts_with(of))
}
