//! NumPy's `.npz`: a zip archive of named `.npy` arrays, stored or deflated.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Cursor, Read, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::atomic;
use super::npy::{self, Array, Element, Values};
use crate::error::{Error, Result};

/// An archive that was opened; arrays are unpacked when asked for.
pub struct Npz {
    path: PathBuf,
    archive: ZipArchive<BufReader<File>>,
}

impl Npz {
    /// Opens the archive at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is no zip archive.
    pub fn open(path: &Path) -> Result<Npz> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        let archive = ZipArchive::new(BufReader::new(file))
            .map_err(|e| Error::file(path, format!("is no .npz archive: {e}; write it with numpy.savez")))?;
        Ok(Npz { path: path.to_owned(), archive })
    }

    /// The names of all arrays, without `.npy`, in the archive's order.
    pub fn names(&self) -> Vec<String> {
        self.archive.file_names().map(|n| n.strip_suffix(".npy").unwrap_or(n).to_owned()).collect()
    }

    /// Whether there is an array of this name.
    pub fn contains(&self, name: &str) -> bool {
        self.archive.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// The array `name`, converted to `T` as [`npy::read`] does.
    ///
    /// # Errors
    /// There is no such array (the message lists those there are), or it is damaged or no array of numbers.
    pub fn array<T: Element>(&mut self, name: &str) -> Result<Array<T>> {
        self.parsed(name, npy::parse)
    }

    /// The array `name` as it is stored.
    ///
    /// # Errors
    /// As [`Npz::array`].
    pub fn raw(&mut self, name: &str) -> Result<npy::Raw> {
        self.parsed(name, npy::parse_raw)
    }

    /// Bytes that the array `name` claims to unpack to, with its header; 0 where there is none.
    pub fn claimed_bytes(&mut self, name: &str) -> u64 {
        self.archive.by_name(&format!("{name}.npy")).map_or(0, |entry| entry.size())
    }

    /// The list of texts `name`.
    ///
    /// # Errors
    /// As [`Npz::array`], for texts.
    pub fn texts(&mut self, name: &str) -> Result<Vec<String>> {
        self.parsed(name, npy::parse_texts)
    }

    fn parsed<A>(
        &mut self,
        name: &str,
        parse: impl Fn(&[u8]) -> std::result::Result<A, String>,
    ) -> Result<A> {
        let fail = |message: String| Error::file(&self.path, format!("array \"{name}\" {message}"));
        let Some(index) = self.archive.index_for_name(&format!("{name}.npy")) else {
            return Err(fail(format!("is missing; the file holds {}", self.names().join(", "))));
        };
        let entry = self.archive.by_index(index).map_err(|e| fail(format!("cannot be unpacked: {e}")))?;
        // The size in the directory is a claim; the limit holds for what is really unpacked.
        let mut bytes = Vec::new();
        entry
            .take(npy::MAX_BYTES + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| fail(format!("cannot be unpacked: {e}")))?;
        if bytes.len() as u64 > npy::MAX_BYTES {
            return Err(fail(format!("unpacks to more than {} bytes", npy::MAX_BYTES)));
        }
        parse(&bytes).map_err(fail)
    }

    /// The array `name` if its shape is `expected`, where `None` stands for any length.
    ///
    /// # Errors
    /// As [`Npz::array`], or the shape differs.
    pub fn shaped<T: Element>(&mut self, name: &str, expected: &[Option<usize>]) -> Result<Array<T>> {
        let array = self.array(name)?;
        array
            .check_shape(expected)
            .map_err(|message| Error::file(&self.path, format!("array \"{name}\" {message}")))?;
        Ok(array)
    }

    /// The file this archive was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// One array to be written.
#[derive(Clone, Copy, Debug)]
pub struct Named<'a> {
    /// Its key, without `.npy`.
    pub name: &'a str,
    /// The length of every axis.
    pub shape: &'a [usize],
    /// The values in C order.
    pub values: Values<'a>,
}

/// Writes the arrays atomically, uncompressed and without time stamps: the same arrays give the same bytes.
///
/// # Errors
/// As [`atomic::write`].
///
/// # Panics
/// If an array's shape does not fit its values.
pub fn write(path: &Path, arrays: &[Named<'_>]) -> Result<()> {
    let pack = || -> zip::result::ZipResult<Vec<u8>> {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        for array in arrays {
            archive.start_file(format!("{}.npy", array.name), options())?;
            archive.write_all(&npy::encode(array.shape, array.values))?;
        }
        Ok(archive.finish()?.into_inner())
    };
    let bytes = pack().map_err(|e| Error::file(path, format!("cannot be packed: {e}")))?;
    atomic::write(path, &bytes)
}

fn options() -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
}

/// An archive that is written block by block, for arrays that are larger than memory.
pub struct Stream<'a> {
    path: &'a Path,
    archive: ZipWriter<&'a mut BufWriter<File>>,
    /// The array that is being written, and how many of its numbers are still to come.
    open: Option<(String, usize)>,
}

impl Stream<'_> {
    /// Begins an f64 array.
    ///
    /// # Errors
    /// The disk is full or the file cannot be written.
    ///
    /// # Panics
    /// If the array before it is not complete, or the shape's product is beyond `usize`.
    pub fn begin(&mut self, name: &str, shape: &[usize]) -> Result<()> {
        self.assert_complete();
        let count = shape.iter().try_fold(1usize, |n, &axis| n.checked_mul(axis));
        let bytes = count.and_then(|n| n.checked_mul(8));
        let (Some(count), Some(bytes)) = (count, bytes) else {
            panic!("npz::Stream: the shape {shape:?} of \"{name}\" has no size");
        };
        // Room for the header too; archives without large files are read by more programs.
        let is_large = bytes as u64 + 1024 > u64::from(u32::MAX);
        let header = npy::header(shape, Values::F64(&[]).description().as_str());
        self.archive
            .start_file(format!("{name}.npy"), options().large_file(is_large))
            .map_err(|e| Error::io(self.path, e.into()))?;
        self.archive.write_all(&header).map_err(|e| Error::io(self.path, e))?;
        self.open = Some((name.to_owned(), count));
        Ok(())
    }

    /// The next numbers of the array, in C order.
    ///
    /// # Errors
    /// As [`Stream::begin`].
    ///
    /// # Panics
    /// If the array has no place for so many.
    pub fn push(&mut self, values: &[f64]) -> Result<()> {
        let left = self.open.as_ref().map_or(0, |(_, left)| *left);
        assert!(values.len() <= left, "npz::Stream: {} numbers, {left} to come", values.len());
        self.archive.write_all(&Values::F64(values).bytes()).map_err(|e| Error::io(self.path, e))?;
        if let Some((_, left)) = &mut self.open {
            *left -= values.len();
        }
        Ok(())
    }

    fn assert_complete(&self) {
        if let Some((name, left)) = &self.open {
            assert!(*left == 0, "npz::Stream: {left} numbers of \"{name}\" are missing");
        }
    }
}

/// Writes an archive atomically as `fill` hands it over; the same arrays give the same bytes.
///
/// # Errors
/// As [`atomic::write`], or whatever `fill` returns.
///
/// # Panics
/// If `fill` leaves an array incomplete.
pub fn write_stream<E: From<Error>>(
    path: &Path,
    fill: impl FnOnce(&mut Stream<'_>) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    let mut failure = None;
    let written = atomic::write_with(path, |out| {
        let mut stream = Stream { path, archive: ZipWriter::new(out), open: None };
        if let Err(why) = fill(&mut stream) {
            failure = Some(why);
            return Err(io::Error::other("not completed"));
        }
        stream.assert_complete();
        stream.archive.finish().map_err(io::Error::from)?.flush()
    });
    match failure {
        Some(why) => Err(why),
        None => Ok(written?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(path: &Path) {
        let a = Named { name: "poses", shape: &[2, 2], values: Values::F64(&[0.1, 0.2, 0.3, 0.4]) };
        let b = Named { name: "f", shape: &[3], values: Values::U32(&[0, 1, 2]) };
        write(path, &[a, b]).unwrap();
    }

    #[test]
    fn arrays_are_read_back_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        sample(&path);
        let mut npz = Npz::open(&path).unwrap();
        assert_eq!(npz.names(), ["poses", "f"]);
        assert_eq!(npz.array::<f64>("poses").unwrap().values, [0.1, 0.2, 0.3, 0.4]);
        assert_eq!(npz.shaped::<f32>("f", &[None]).unwrap().values, [0.0, 1.0, 2.0]);
        assert!(npz.contains("f") && !npz.contains("g"));
        assert!(
            npz.array::<f64>("g")
                .unwrap_err()
                .to_string()
                .contains("\"g\" is missing; the file holds poses, f")
        );
        let shape = npz.shaped::<f64>("poses", &[Some(2), Some(3)]).unwrap_err().to_string();
        assert!(shape.contains("has the shape [2, 2], expected [2, 3]"), "{shape}");
        let first = std::fs::read(&path).unwrap();
        sample(&path);
        assert_eq!(first, std::fs::read(&path).unwrap(), "same arrays, same bytes");
    }

    #[test]
    fn an_array_of_any_type_is_read_as_it_is_stored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        sample(&path);
        let mut npz = Npz::open(&path).unwrap();
        let raw = npz.raw("f").unwrap();
        assert_eq!((raw.kind.as_str(), &raw.shape[..], raw.bytes.len()), ("u4", &[3][..], 12));
        assert!(npz.claimed_bytes("poses") > 32 && npz.claimed_bytes("g") == 0);
    }

    #[test]
    fn deflated_arrays_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let mut archive = ZipWriter::new(std::fs::File::create(&path).unwrap());
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        archive.start_file("x.npy", options).unwrap();
        archive.write_all(&npy::encode(&[1000], Values::F64(&[0.25; 1000]))).unwrap();
        archive.finish().unwrap();
        assert_eq!(Npz::open(&path).unwrap().array::<f64>("x").unwrap().values, [0.25; 1000]);
    }

    #[test]
    fn what_is_streamed_is_what_is_written_at_once_and_a_failure_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let [whole, streamed] = ["whole.npz", "streamed.npz"].map(|name| folder.path().join(name));
        let (a, b) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.5]);
        let named = |name, shape, values| Named { name, shape, values: Values::F64(values) };
        write(&whole, &[named("a", &[3, 2], &a), named("b", &[1], &b)]).unwrap();
        let in_blocks = |out: &mut Stream<'_>| {
            out.begin("a", &[3, 2])?;
            out.push(&a[..4])?;
            out.push(&a[4..])?;
            out.begin("b", &[1])?;
            out.push(&b)
        };
        write_stream::<Error>(&streamed, in_blocks).unwrap();
        let mut found = Npz::open(&streamed).unwrap();
        let mut expected = Npz::open(&whole).unwrap();
        for name in ["a", "b"] {
            assert_eq!(found.array::<f64>(name).unwrap(), expected.array::<f64>(name).unwrap());
        }
        let once = std::fs::read(&streamed).unwrap();
        write_stream::<Error>(&streamed, in_blocks).unwrap();
        assert_eq!(once, std::fs::read(&streamed).unwrap(), "same arrays, same bytes");

        let failed = write_stream(&streamed, |out| {
            out.begin("a", &[3, 2])?;
            Err(Error::Unanswerable("planted".into()))
        });
        assert_eq!(failed.unwrap_err().to_string(), "planted");
        assert_eq!(once, std::fs::read(&streamed).unwrap(), "the old content");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    #[should_panic(expected = "2 numbers of \"a\" are missing")]
    fn an_incomplete_array_is_the_caller_s_mistake() {
        let folder = tempfile::tempdir().unwrap();
        let _ = write_stream::<Error>(&folder.path().join("a.npz"), |out| {
            out.begin("a", &[3])?;
            out.push(&[1.0])
        });
    }

    proptest! {
        #[test]
        fn damaged_archives_never_panic(at in 0usize..500, to in any::<u8>(), cut in 0usize..600) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.npz");
            sample(&path);
            let mut bytes = std::fs::read(&path).unwrap();
            let n = bytes.len();
            bytes[at % n] = to;
            bytes.truncate(n - cut % 50 * usize::from(cut > 300));
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(mut npz) = Npz::open(&path) {
                let _ = npz.array::<f64>("poses");
                let _ = npz.array::<f32>("f");
            }
        }
    }
}
