//! Files that are not read, and what to do about them: by their names, where they lie beside recordings, and by
//! how they begin, where somebody names them.
//!
//! In: a name ([`beside`]), or the first bytes of a file ([`kind`]). Out: words for an error or a message.

/// How names of compressed recordings end, what decompresses them, and how compressed bytes begin (none: they are not
/// known by that) and are called.
const COMPRESSED: [(&str, &str, &[u8], &str); 8] = [
    ("zst", "zstd -d", &[0x28, 0xb5, 0x2f, 0xfd], "zstd"),
    ("zstd", "zstd -d", &[0x28, 0xb5, 0x2f, 0xfd], "zstd"),
    ("gz", "gunzip", &[0x1f, 0x8b], "gzip"),
    ("lz4", "lz4 -d", &[0x04, 0x22, 0x4d, 0x18], "lz4"),
    ("bz2", "bunzip2", b"BZh", "bzip2"),
    ("xz", "unxz", &[0xfd, b'7', b'z', b'X', b'Z'], "xz"),
    ("zip", "unzip", &[], "zip"),
    ("7z", "7z x", &[], "7z"),
];
/// How names of recordings of others end, what they are, and what to do.
const OTHERS: [(&str, &str, &str); 4] = [
    (".bag", "a bag of ROS 1", "`rosbags-convert` makes ROS 2 of it"),
    (".db3", "a bag of ROS 2 in SQLite", "`mcap convert` makes MCAP of it"),
    (".mcap.active", "not closed yet", "rename it when its recorder has ended"),
    (".bag.active", "not closed yet", "`rosbag reindex` closes it"),
];

/// Why a file of this name is not read although it looks like a recording. `None`: it does not look like one.
pub fn beside(name: &str) -> Option<String> {
    let name = name.to_lowercase();
    // as logrotate, copies and people name what they put aside: `a.mcap.1`, `a.mcap.20260131`, `a.mcap.old`
    let is_aside = |name: &str| {
        name.rsplit_once(".mcap.").is_some_and(|(_, aside)| {
            ["old", "bak", "orig"].contains(&aside)
                || aside.bytes().all(|c| c.is_ascii_digit() || b"-_t".contains(&c))
        })
    };
    if let Some((rest, ending)) = name.rsplit_once('.')
        && let Some((_, by, ..)) = COMPRESSED.iter().find(|(of, ..)| *of == ending)
        && (rest.ends_with(".mcap") || is_aside(rest))
    {
        return Some(format!("compressed, and not read: `{by}` first"));
    }
    if is_aside(&name) {
        return Some("not called *.mcap, and not read: rename it so that it ends in .mcap".into());
    }
    let other = OTHERS.iter().find(|(of, ..)| name.ends_with(of));
    other.map(|(_, what, advice)| format!("{what}, and not read: {advice}"))
}

/// The name of the recording that a compressed file holds.
pub fn decompressed(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((rest, ending))
            if COMPRESSED.iter().any(|(of, ..)| ending.eq_ignore_ascii_case(of)) =>
        {
            rest
        }
        _ => name,
    }
}

/// What compressed these bytes, by how they begin.
pub fn compressed_by(bytes: &[u8]) -> Option<&'static str> {
    let begins = |magic: &[u8]| !magic.is_empty() && bytes.starts_with(magic);
    COMPRESSED.iter().find(|(.., magic, _)| begins(magic)).map(|(.., name)| *name)
}

/// How files begin that people name as recordings or tables, and what they are.
const KINDS: [(usize, &[u8], &str); 17] = [
    (0, b"#ROSBAG", "a bag of ROS 1 (`rosbags-convert` makes ROS 2 of it)"),
    (0, b"SQLite format 3", "a bag of ROS 2 in SQLite (`mcap convert` makes MCAP of it)"),
    (0, b"\x89HDF\r\n\x1a\n", "HDF5, as MATLAB writes it, too"),
    (0, b"MATLAB 5.0 MAT-file", "a MAT file of MATLAB"),
    (8, b"WAVE", "a WAV file"),
    (0, b"TDSm", "a TDMS file of LabVIEW"),
    (0, b"\x93NUMPY", "an array of NumPy"),
    (0, b"PK\x03\x04", "a zip file, such as arrays of NumPy or a workbook"),
    (0, b"\xd0\xcf\x11\xe0", "a workbook of Excel"),
    (0, b"ARROW1", "an Arrow file"),
    (0, b"\xff\xff\xff\xff", "an Arrow stream"),
    (0, b"MDF     ", "an MDF file"),
    (0, b"<!DOCTYPE", "an HTML page, such as a server sends instead of a file"),
    (0, b"<!doctype", "an HTML page, such as a server sends instead of a file"),
    (0, b"<html", "an HTML page, such as a server sends instead of a file"),
    (0, b"version https://git-lfs", "a pointer of Git LFS (`git lfs pull` fetches the file)"),
    (0, b"ULog\x01\x12\x35", "a ULog file"),
];

/// What a file is that begins so; `None`: that is not known.
pub fn kind(start: &[u8]) -> Option<String> {
    // a few bytes tell all of these apart
    let begins = |(at, magic, _): &&(usize, &[u8], &str)| {
        let start = start.get(*at..).unwrap_or_default();
        start.len() >= 4 && magic.iter().zip(start).all(|(a, b)| a == b)
    };
    let known = KINDS.iter().find(begins).map(|(.., what)| (*what).to_owned());
    known.or_else(|| Some(format!("compressed by {} (decompress it first)", compressed_by(start)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_look_like_recordings_are_told_and_others_are_not() {
        for name in [
            "a.mcap.zst",
            "A.MCAP.GZ",
            "b_0.mcap.lz4",
            "x.bag",
            "x_0.db3",
            "n.mcap.active",
            "k.mcap.7z",
            "a.mcap.1",
            "a.mcap.2.gz",
            "a.mcap.2026-01-31",
            "A.mcap.OLD",
        ] {
            assert!(beside(name).is_some_and(|why| why.contains("not ")), "{name}");
        }
        for name in
            ["a.mcap", "a.mcap.part", "notes.txt.gz", "a.mcapx", "bag", "labels.csv", "x.bag.txt"]
        {
            assert_eq!(beside(name), None, "{name}");
        }
        assert_eq!(
            ["a.mcap.zst", "a.MCAP.GZ", "a.bag"].map(decompressed),
            ["a.mcap", "a.MCAP", "a.bag"]
        );
    }

    #[test]
    fn bags_are_known_by_how_they_begin() {
        for (start, says) in [(&b"#ROSBAG V2.0\n"[..], "ROS 1"), (b"SQLite format 3\0", "ROS 2")] {
            assert!(kind(start).is_some_and(|what| what.contains(says)), "{says}");
        }
    }
}
