//! The archive: a gzip-compressed tar file, which every system opens.

use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Size of a block of a tar file.
const BLOCK: usize = 512;
/// Folder of all entries.
const FOLDER: &str = "plumbline-report";
/// Longest name of an entry, with the folder.
const MAX_NAME: usize = 100;

/// An archive that is being written.
pub struct ReportArchive {
    out: GzEncoder<BufWriter<File>>,
}

impl ReportArchive {
    /// Creates the file, replacing one of that name.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = BufWriter::new(File::create(path)?);
        Ok(Self { out: GzEncoder::new(file, Compression::default()) })
    }

    /// Adds a file. Owner and time are left out.
    pub fn add(&mut self, name: &str, content: &[u8]) -> io::Result<()> {
        self.out.write_all(&header(&format!("{FOLDER}/{name}"), content.len())?)?;
        self.out.write_all(content)?;
        let rest = content.len() % BLOCK;
        if rest > 0 {
            self.out.write_all(&[0; BLOCK][rest..])?;
        }
        Ok(())
    }

    /// Ends the archive.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.write_all(&[0; 2 * BLOCK])?;
        self.out.finish()?.flush()
    }
}

/// Header of an entry (POSIX ustar).
fn header(name: &str, bytes: usize) -> io::Result<[u8; BLOCK]> {
    if name.len() > MAX_NAME {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{name}: too long a name")));
    }
    let mut header = [0; BLOCK];
    let mut put = |at: usize, text: &str| header[at..at + text.len()].copy_from_slice(text.as_bytes());
    put(0, name);
    put(100, "0000644\0");
    put(108, "0000000\0");
    put(116, "0000000\0");
    put(124, &format!("{bytes:011o}\0"));
    put(136, "00000000000\0");
    put(156, "0");
    put(257, "ustar\x0000");
    // The sum is taken with blanks in its place.
    put(148, "        ");
    let sum: u32 = header.iter().map(|byte| u32::from(*byte)).sum();
    header[148..156].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
    Ok(header)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn tar_lists_and_extracts_what_was_added() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.tar.gz");
        let mut archive = ReportArchive::create(&path).unwrap();
        let long = vec![b'x'; 3 * BLOCK + 7];
        archive.add("a.txt", b"hello\n").unwrap();
        archive.add("long.csv", &long).unwrap();
        archive.add("empty", b"").unwrap();
        assert!(archive.add(&"n".repeat(90), b"").is_err());
        archive.finish().unwrap();
        let extracted =
            Command::new("tar").arg("-xzf").arg(&path).arg("-C").arg(folder.path()).output().unwrap();
        assert!(extracted.status.success() && extracted.stderr.is_empty(), "{extracted:?}");
        let read = |name: &str| std::fs::read(folder.path().join(FOLDER).join(name)).unwrap();
        assert_eq!((read("a.txt"), read("long.csv"), read("empty")), (b"hello\n".to_vec(), long, Vec::new()));
    }
}
