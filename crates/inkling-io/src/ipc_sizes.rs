//! Checks the sizes that an Arrow IPC file or stream claims, before the arrow crate reads it. That
//! crate allocates whatever a message says, and an allocation that fails ends the process.
//!
//! In, from `columnar.rs`: all bytes of a file. Out: nothing, or in words what is wrong. The rule:
//! every message and every buffer in it must lie within the bytes, and the buffers of one message
//! may claim at most 1 GiB uncompressed. The content itself is not checked here.

use arrow_ipc::{Message, RecordBatch, root_as_footer, root_as_message};

/// Most bytes that all compressed buffers of one message may claim to have uncompressed.
const MOST: i64 = 1 << 30;
/// A file begins and ends with these bytes.
const MAGIC: &[u8] = b"ARROW1";
/// These bytes stand before each message since version 0.15 of the format; then the length of the
/// message's head (4 bytes) follows.
const CONTINUES: [u8; 4] = [0xff; 4];

/// Checks a file: its footer says where the messages lie, and each must lie within the file. The
/// layout from the end: the magic bytes, the footer's length (4 bytes), the footer.
pub fn check_file(bytes: &[u8]) -> Result<(), String> {
    let odd = || "its footer points nowhere".to_owned();
    let end = bytes.strip_suffix(MAGIC).ok_or("it ends before its footer")?;

    let (rest, length) = end.split_last_chunk::<4>().ok_or_else(odd)?;
    let length = usize::try_from(i32::from_le_bytes(*length)).map_err(|_| odd())?;
    let at = rest.len().checked_sub(length).ok_or_else(odd)?;
    let footer = root_as_footer(&rest[at..]).map_err(|e| format!("its footer: {e}"))?;

    let blocks = footer.dictionaries().into_iter().chain(footer.recordBatches()).flatten();
    for block in blocks {
        let (at, head) = (block.offset(), i64::from(block.metaDataLength()));
        let message = part(bytes, at, head).ok_or_else(odd)?;
        let body = at.checked_add(head).and_then(|at| part(bytes, at, block.bodyLength()));
        // the head of a message stands behind its length, which the footer has said already
        let message = message.strip_prefix(&CONTINUES).unwrap_or(message);
        check_message(message.get(4..).ok_or_else(odd)?, body.ok_or_else(odd)?)?;
    }
    Ok(())
}

pub fn check_stream(mut bytes: &[u8]) -> Result<(), String> {
    let short = || "it ends within a message".to_owned();
    while !bytes.is_empty() {
        bytes = bytes.strip_prefix(&CONTINUES).unwrap_or(bytes);
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(short)?;
        let length = usize::try_from(i32::from_le_bytes(*length)).map_err(|_| short())?;
        if length == 0 {
            return Ok(()); // the end, as the format has it
        }
        let (message, rest) = rest.split_at_checked(length).ok_or_else(short)?;
        let body = root_as_message(message).map_err(|e| format!("a message: {e}"))?.bodyLength();
        let body = usize::try_from(body).map_err(|_| short())?;
        let (body, rest) = rest.split_at_checked(body).ok_or_else(short)?;
        check_message(message, body)?;
        bytes = rest;
    }
    Ok(())
}

fn part(bytes: &[u8], from: i64, length: i64) -> Option<&[u8]> {
    let from = usize::try_from(from).ok()?;
    bytes.get(from..from.checked_add(usize::try_from(length).ok()?)?)
}

fn check_message(message: &[u8], body: &[u8]) -> Result<(), String> {
    let message: Message = root_as_message(message).map_err(|e| format!("a message: {e}"))?;
    if usize::try_from(message.bodyLength()).ok() != Some(body.len()) {
        return Err("a message of another length than the file says".into());
    }
    let of_dictionary = message.header_as_dictionary_batch().and_then(|d| d.data());
    let batch: Option<RecordBatch> = message.header_as_record_batch().or(of_dictionary);
    let Some(batch) = batch else { return Ok(()) };

    let mut all = 0i64;
    for buffer in batch.buffers().into_iter().flatten() {
        let part = part(body, buffer.offset(), buffer.length());
        let part = part.ok_or("a buffer beyond its message")?;
        // a buffer that is not compressed takes no more than its own bytes
        if batch.compression().is_none() {
            continue;
        }
        // a compressed buffer begins with its uncompressed length (8 bytes); -1: stored as it is
        if let Some(length) = part.first_chunk().map(|n| i64::from_le_bytes(*n))
            && length != -1
        {
            let more = all.checked_add(length).filter(|all| length >= 0 && *all <= MOST);
            all = more.ok_or_else(|| {
                format!("a message that claims more than {MOST} bytes uncompressed")
            })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::{ArrayRef, Int16Array, RecordBatch};
    use arrow_ipc::writer::{FileWriter, IpcWriteOptions, StreamWriter};
    use std::sync::Arc;

    #[test]
    fn what_the_library_writes_is_sound_and_a_larger_claim_is_not() {
        let numbers: ArrayRef = Arc::new((0..500).map(|k| k % 7).collect::<Int16Array>());
        let batch = RecordBatch::try_from_iter([("a", numbers)]).unwrap();
        let (schema, lz4) = (batch.schema(), Some(arrow_ipc::CompressionType::LZ4_FRAME));
        let options = IpcWriteOptions::default().try_with_compression(lz4).unwrap();
        let file = FileWriter::try_new_with_options(Vec::new(), &schema, options.clone());
        let mut file = file.unwrap();
        file.write(&batch).unwrap();
        let mut file = file.into_inner().unwrap();
        let stream = StreamWriter::try_new_with_options(Vec::new(), &schema, options);
        let mut stream = stream.unwrap();
        stream.write(&batch).unwrap();
        let mut stream = stream.into_inner().unwrap();
        check_file(&file).unwrap();
        check_stream(&stream).unwrap();
        // the 1000 bytes of the numbers claim to be 2^60
        let claim = |bytes: &mut Vec<u8>| {
            let of = 1000i64.to_le_bytes();
            let at = bytes.windows(8).position(|w| w == of).unwrap();
            bytes[at + 7] = 0x10;
        };
        claim(&mut file);
        claim(&mut stream);
        assert!(check_file(&file).unwrap_err().contains("claims more than"));
        assert!(check_stream(&stream).unwrap_err().contains("claims more than"));
        for cut in 0..stream.len() {
            drop(check_stream(&stream[..cut]));
            drop(check_file(&file[..cut]));
        }
    }
}
