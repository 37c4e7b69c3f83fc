//! Decompresses the chunks of MCAP files. It reads no file: `chunk_loader.rs` calls it.
//!
//! In: the name of the compression, a chunk's compressed bytes, and a buffer of the size that the
//! chunk claims (which the caller has checked). Out: the buffer filled exactly, or a sentence on
//! why not. No memory is allocated by a size that the bytes claim.

use std::io::Read;

/// Decompresses chunks. zstd's context is large, so it is kept from chunk to chunk.
#[derive(Default)]
pub struct Decompressor {
    zstd: zstd::bulk::Decompressor<'static>,
}

impl Decompressor {
    pub fn decompress(
        &mut self,
        compression: &str,
        compressed: &[u8],
        out: &mut [u8],
    ) -> Result<(), String> {
        match compression {
            "zstd" => self.zstd(compressed, out),
            "lz4" => lz4(compressed, out),
            other => Err(format!(
                "unknown compression `{}`: none, lz4 and zstd can be read",
                other.chars().take(32).collect::<String>().escape_debug()
            )),
        }
    }

    fn zstd(&mut self, compressed: &[u8], out: &mut [u8]) -> Result<(), String> {
        // in one step into a buffer of fixed size: the size that the frame itself claims is not used
        match self.zstd.decompress_to_buffer(compressed, out).map_err(|e| format!("zstd: {e}"))? {
            n if n == out.len() => Ok(()),
            n => Err(format!("{n} bytes, but the chunk claims {}", out.len())),
        }
    }
}

/// Decompresses LZ4 in its frame format. The library's buffers are three blocks of 8 MiB at most.
fn lz4(compressed: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut decoder = lz4_flex::frame::FrameDecoder::new(compressed);
    decoder.read_exact(out).map_err(|e| format!("lz4: {e}"))?;
    // the end mark and the frame's own checksum come after the last byte, and are read only by a further read
    match decoder.read(&mut [0]) {
        Ok(0) => Ok(()),
        Ok(_) => Err(format!("lz4: more than the {} bytes that the chunk claims", out.len())),
        Err(e) => Err(format!("lz4: {e}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// The same bytes by each compression.
    fn compressed(bytes: &[u8]) -> [(&'static str, Vec<u8>); 2] {
        let mut lz4 = lz4_flex::frame::FrameEncoder::new(Vec::new());
        lz4.write_all(bytes).unwrap();
        [("zstd", zstd::bulk::compress(bytes, 1).unwrap()), ("lz4", lz4.finish().unwrap())]
    }

    #[test]
    fn every_compression_gives_back_what_went_in_and_nothing_of_another_size() {
        let bytes: Vec<u8> = (0..300_000u32).map(|i| (i * i / 7) as u8).collect();
        let mut decompressor = Decompressor::default();
        for (compression, compressed) in compressed(&bytes) {
            let mut out = vec![0; bytes.len()];
            decompressor.decompress(compression, &compressed, &mut out).unwrap();
            assert_eq!(out, bytes);
            for claimed in [0, bytes.len() - 1, bytes.len() + 1] {
                let mut out = vec![0; claimed];
                assert!(decompressor.decompress(compression, &compressed, &mut out).is_err());
            }
            // The end mark and checksum (8 bytes) cut off an lz4 frame leave its data whole.
            let cut = &compressed[..compressed.len() - 9];
            assert!(decompressor.decompress(compression, cut, &mut out).is_err());
        }
        assert!(decompressor.decompress("brotli", &[], &mut []).unwrap_err().contains("brotli"));
    }

    #[test]
    fn a_zstd_frame_that_lies_about_its_size_allocates_nothing() {
        // Magic, single segment with an 8-byte content size of 2^60, one empty last block.
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0xe0];
        frame.extend((1u64 << 60).to_le_bytes());
        frame.extend([1, 0, 0]);
        let mut out = vec![0; 100];
        assert!(Decompressor::default().decompress("zstd", &frame, &mut out).is_err());
    }
}
