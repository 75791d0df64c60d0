//! Whether a JPEG is all there: its markers from the first to the end of the image (ITU-T T.81, annex B).
//!
//! Decoders fill what is missing with grey, so that a file that was cut off looks like a picture.

const END_OF_IMAGE: u8 = 0xd9;

/// Whether the end of the image comes before the end of the file. What follows it (another picture, padding) does not matter.
///
/// A segment says how long it is, so that an end inside it, as of a thumbnail, is not taken for the picture's. What stands between
/// a scan's header and the next marker is skipped, and so are stray bytes between segments, as decoders do.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    let mut at = 0;
    while let Some(&[mark, code]) = bytes.get(at..at + 2).and_then(|pair| pair.first_chunk()) {
        match (mark, code) {
            (0xff, END_OF_IMAGE) => return true,
            (0xff, code) if has_length(code) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4).and_then(|pair| pair.first_chunk()) else {
                    return false;
                };
                at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2);
            }
            // A coded 0xff, a restart or the image's start; two fill bytes are told apart by the second.
            (0xff, code) if code != 0xff => at += 2,
            _ => at += 1,
        }
    }
    false
}

/// Whether a marker begins a segment that is followed by its length: all but fill, coded 0xff, TEM, restarts, start and end.
fn has_length(code: u8) -> bool {
    !matches!(code, 0x00 | 0x01 | 0xd0..=0xd9 | 0xff)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
    use proptest::prelude::*;
    use std::io::Cursor;

    fn jpeg() -> Vec<u8> {
        let noise =
            |x: u32, y: u32| Rgb([0, 1, 2].map(|c| (x * x * 7 + y * y * 13 + x * y * 5 + c * 31) as u8));
        let mut file = Cursor::new(Vec::new());
        DynamicImage::from(RgbImage::from_fn(67, 45, noise)).write_to(&mut file, ImageFormat::Jpeg).unwrap();
        file.into_inner()
    }

    /// With a segment of an application behind the start of the image.
    fn with_segment(content: &[u8]) -> Vec<u8> {
        let file = jpeg();
        let length = u16::try_from(content.len() + 2).unwrap().to_be_bytes();
        [&file[..2], &[0xff, 0xe1], &length, content, &file[2..]].concat()
    }

    #[test]
    fn a_jpeg_is_whole_until_a_byte_is_missing_at_its_end() {
        let file = jpeg();
        assert!(is_whole(&file));
        for length in 0..file.len() {
            assert!(!is_whole(&file[..length]), "{length} of {} bytes", file.len());
        }
    }

    #[test]
    fn what_follows_the_end_does_not_matter() {
        for tail in [&b"\0\0\0"[..], b"\xff\xff", b"\xff\xd8\xff\xda", &jpeg()[..]] {
            assert!(is_whole(&[&jpeg()[..], tail].concat()));
        }
    }

    #[test]
    fn the_end_of_a_thumbnail_is_not_the_picture_s() {
        let file = with_segment(&jpeg());
        assert!(is_whole(&file) && !is_whole(&file[..file.len() / 2]) && !is_whole(&file[..file.len() - 2]));
    }

    #[test]
    fn fill_and_stray_bytes_between_segments_are_skipped() {
        let file = with_segment(b"");
        let between = [&file[..6], b"\0\x12\xff\xff\xff", &file[6..]].concat();
        assert!(is_whole(&between));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(prop_oneof![Just(0xff), any::<u8>()], 0..64)) {
            is_whole(&bytes);
        }
    }
}
