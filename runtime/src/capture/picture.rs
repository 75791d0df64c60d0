//! PNG and JPEG in and out, with memory bounded before anything is decoded.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, GrayImage, ImageEncoder, ImageFormat, ImageReader, RgbImage};

use super::camera::MAX_PIXELS;
use super::jpeg;
use crate::error::{Error, Result};
use crate::file::{atomic, read_bytes};

/// A pixel takes at most eight bytes while decoding (16 bits, four channels), and decoders hold a few rows more.
const MAX_DECODER_BYTES: u64 = 9 * MAX_PIXELS;

/// Compressed files beyond this are refused; a lossless picture of [`MAX_PIXELS`] colours fits.
const MAX_FILE_BYTES: u64 = 4 * MAX_PIXELS;

/// Reads a PNG or JPEG, checking its size before decoding when one is `expected` (width, height).
///
/// # Errors
/// The file cannot be read, is neither PNG nor JPEG (whatever its name says), is damaged, or has another size.
pub(crate) fn read(path: &Path, expected: Option<(u32, u32)>) -> Result<DynamicImage> {
    let bytes = read_bytes(path, MAX_FILE_BYTES)?;
    let reader = || {
        let mut reader = ImageReader::new(Cursor::new(&bytes[..]))
            .with_guessed_format()
            .map_err(|e| Error::io(path, e))?;
        if reader.format().is_none() {
            return Err(Error::file(path, "is neither a PNG nor a JPEG picture; save it again as PNG"));
        }
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(MAX_DECODER_BYTES);
        reader.limits(limits);
        Ok(reader)
    };
    let damaged =
        |e: image::ImageError| Error::file(path, format!("cannot be decoded: {e}; save it again as PNG"));
    let (width, height) = reader()?.into_dimensions().map_err(damaged)?;
    if let Some((w, h)) = expected.filter(|&size| size != (width, height)) {
        return Err(Error::file(
            path,
            format!(
                "is {width} × {height} pixels, but its camera says {w} × {h}: resize it or correct the camera"
            ),
        ));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(Error::file(
            path,
            format!("is {width} × {height} pixels; at most {MAX_PIXELS} are read: scale it down"),
        ));
    }
    let reader = reader()?;
    if reader.format() == Some(ImageFormat::Jpeg) && !jpeg::is_whole(&bytes) {
        let message = format!(
            "ends before its picture does: the JPEG of {} bytes has no end-of-image marker; copy or save it again",
            bytes.len()
        );
        return Err(Error::file(path, message));
    }
    reader.decode().map_err(damaged)
}

/// Reads a PNG or JPEG as RGB; transparency is dropped.
///
/// # Errors
/// The file cannot be read, is neither PNG nor JPEG (whatever its name says), is damaged, or has another size than `expected`.
pub fn read_rgb(path: &Path, expected: Option<(u32, u32)>) -> Result<RgbImage> {
    Ok(read(path, expected)?.into_rgb8())
}

/// Reads a PNG or JPEG as a mask: 255 where the luma is at least 128, else 0.
///
/// # Errors
/// The file cannot be read, is neither PNG nor JPEG (whatever its name says), is damaged, or has another size than `expected`.
pub fn read_mask(path: &Path, expected: Option<(u32, u32)>) -> Result<GrayImage> {
    let mut mask = read(path, expected)?.into_luma8();
    for value in mask.iter_mut() {
        *value = if *value >= 128 { 255 } else { 0 };
    }
    Ok(mask)
}

/// The width and height that a picture's header declares.
///
/// # Errors
/// The file cannot be read or has no readable header.
pub fn dimensions(path: &Path) -> Result<(u32, u32)> {
    let reader =
        ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| Error::io(path, e))?;
    if reader.format().is_none() {
        return Err(Error::file(path, "is neither a PNG nor a JPEG picture; save it again as PNG"));
    }
    reader.into_dimensions().map_err(|e| Error::file(path, format!("cannot be decoded: {e}")))
}

/// Writes RGB as PNG, atomically; the same picture gives the same bytes.
///
/// # Errors
/// As [`atomic::write`].
pub fn write_rgb(path: &Path, image: &RgbImage) -> Result<()> {
    write(path, image.as_raw(), image.dimensions(), ExtendedColorType::Rgb8)
}

/// Writes grey values as PNG, atomically.
///
/// # Errors
/// As [`atomic::write`].
pub fn write_gray(path: &Path, image: &GrayImage) -> Result<()> {
    write(path, image.as_raw(), image.dimensions(), ExtendedColorType::L8)
}

fn write(path: &Path, pixels: &[u8], (width, height): (u32, u32), color: ExtendedColorType) -> Result<()> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(pixels, width, height, color)
        .map_err(|e| Error::file(path, format!("cannot be encoded as PNG: {e}")))?;
    atomic::write(path, &bytes)
}

/// The first of `folder/NAME.png`, `.jpg`, `.jpeg` that exists.
pub(crate) fn find(folder: &Path, name: &str, extensions: &[&str]) -> Option<PathBuf> {
    extensions.iter().map(|e| folder.join(format!("{name}.{e}"))).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gradient() -> RgbImage {
        RgbImage::from_fn(31, 17, |x, y| image::Rgb([8 * x as u8, 15 * y as u8, (x * y) as u8]))
    }

    #[test]
    fn a_png_brings_back_the_same_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_rgb(&path, &gradient()).unwrap();
        assert_eq!(read_rgb(&path, Some((31, 17))).unwrap(), gradient());
        assert_eq!(dimensions(&path).unwrap(), (31, 17));
        let wrong = read_rgb(&path, Some((17, 31))).unwrap_err().to_string();
        assert!(wrong.contains("is 31 × 17 pixels, but its camera says 17 × 31"), "{wrong}");
    }

    #[test]
    fn mask_values_from_128_are_body() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_gray(&path, &GrayImage::from_raw(4, 1, vec![0, 127, 128, 255]).unwrap()).unwrap();
        assert_eq!(read_mask(&path, None).unwrap().into_raw(), [0, 0, 255, 255]);
    }

    #[test]
    fn a_png_that_is_not_one_is_refused_and_a_jpeg_named_png_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "not a picture").unwrap();
        assert!(
            read_rgb(&path, None).unwrap_err().to_string().contains("a.png: is neither a PNG nor a JPEG")
        );
        let mut jpeg = Cursor::new(Vec::new());
        DynamicImage::from(gradient()).write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
        std::fs::write(&path, jpeg.into_inner()).unwrap();
        assert_eq!(read_rgb(&path, None).unwrap().dimensions(), (31, 17));
    }

    #[test]
    fn a_jpeg_that_was_cut_off_is_refused_and_one_with_more_behind_its_end_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let mut jpeg = Cursor::new(Vec::new());
        DynamicImage::from(gradient()).write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
        let whole = jpeg.into_inner();
        std::fs::write(&path, &whole).unwrap();
        let read = read_rgb(&path, None).unwrap();
        std::fs::write(&path, [&whole[..], b"padding"].concat()).unwrap();
        assert_eq!(read_rgb(&path, None).unwrap(), read);
        for length in [whole.len() - 1, whole.len() - 20] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let cut = read_rgb(&path, None).unwrap_err().to_string();
            assert!(cut.contains("a.jpg: ends before its picture does"), "{cut}");
        }
    }

    #[test]
    fn a_header_that_declares_a_huge_picture_is_refused_before_decoding() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_rgb(&path, &gradient()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        std::fs::write(&path, bytes).unwrap();
        assert!(read_rgb(&path, None).is_err());
        assert!(read_rgb(&path, Some((31, 17))).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn damaged_pictures_never_panic(at in 8usize..400, to in any::<u8>(), cut in 0usize..400) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.png");
            write_rgb(&path, &gradient()).unwrap();
            let mut bytes = std::fs::read(&path).unwrap();
            let n = bytes.len();
            bytes[at % n] = to;
            std::fs::write(&path, &bytes).unwrap();
            let _ = read_rgb(&path, Some((31, 17)));
            bytes.truncate(cut % n);
            std::fs::write(&path, &bytes).unwrap();
            let _ = read_mask(&path, None);
        }
    }
}
