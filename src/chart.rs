//! Line and bar charts as SVG or PNG files.

mod canvas;

use std::error::Error;
use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use vitruvian_runtime::capture::picture;
use vitruvian_runtime::file::atomic;

use self::canvas::Canvas;
use crate::failure::{Failure, Result};

/// Width and height of a chart in pixels; a PNG has [`PNG_UNIT`] times as many.
const SIZE: (u32, u32) = (720, 440);

/// Pixels of a PNG for each of [`SIZE`], so that its bitmap font and its lines are fine enough.
const PNG_UNIT: u32 = 2;

/// Size of the legend's letters: plotters makes its box for letters of an average width, which those of the bitmap font,
/// drawn at a whole number of pixels a dot, do not exceed at this size.
const LEGEND: u32 = 14;

/// Colours that are told apart by most eyes (Okabe and Ito 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
    RGBColor(120, 120, 120),
];
const FRAME: RGBColor = COLOURS[7];

/// The most lines that a chart has colours for.
pub const MAX_SERIES: usize = COLOURS.len() - 1;

/// A named row of points.
pub struct Series {
    /// What the legend says.
    pub name: String,
    /// (x, y), joined in this order.
    pub points: Vec<(f64, f64)>,
}

/// The vertical axis of a chart of lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From 0.
    Linear,
    /// From 0 to 100, with the legend in the lower right corner, where curves that rise to 100 leave room.
    Percent,
    /// In powers of ten from this value, at which smaller ones are drawn.
    Logarithmic(f64),
}

impl Scale {
    fn height(self, value: f64) -> f64 {
        match self {
            Scale::Linear | Scale::Percent => value,
            Scale::Logarithmic(least) => value.max(least).log10(),
        }
    }

    fn label(self, height: f64) -> String {
        match self {
            Scale::Linear => format!("{height:.2}"),
            Scale::Percent => format!("{height:.0}"),
            Scale::Logarithmic(_) => format!("{}", 10f64.powf(height)),
        }
    }
}

/// Whether a chart can be written to a file of this name: .svg or .png.
///
/// # Errors
/// It has another extension.
pub fn check_path(path: &Path) -> Result<()> {
    is_png(path).map(|_| ())
}

fn is_png(path: &Path) -> Result<bool> {
    match path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase().as_str() {
        "svg" => Ok(false),
        "png" => Ok(true),
        _ => Err(Failure::Usage(format!("{}: a chart is written as .svg or .png", path.display()))),
    }
}

/// What is drawn with plotters, which reports a failure of one of two kinds of canvas.
type Drawn = std::result::Result<(), Box<dyn Error>>;

/// Draws on a canvas of the kind that the file's name asks for, then writes the file.
macro_rules! draw {
    ($path:expr, $area:ident, $unit:ident, $drawing:expr) => {{
        let path: &Path = $path;
        let failed =
            |why: Box<dyn Error>| Failure::Usage(format!("{}: cannot be drawn: {why}", path.display()));
        if is_png(path)? {
            let mut canvas = Canvas::new(SIZE.0 * PNG_UNIT, SIZE.1 * PNG_UNIT);
            {
                let $unit = PNG_UNIT;
                let $area = (&mut canvas).into_drawing_area();
                $drawing.map_err(failed)?;
            }
            picture::write_rgb(path, &canvas.into_image())?;
        } else {
            let mut text = String::new();
            {
                let $unit = 1;
                let $area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
                $drawing.map_err(failed)?;
            }
            atomic::write(path, text.as_bytes())?;
        }
        Ok(())
    }};
}

/// Draws `series` as lines, their points marked unless they are percentages.
///
/// # Errors
/// The file's name ends neither in .svg nor in .png, or it cannot be written.
///
/// # Panics
/// If there are more than [`MAX_SERIES`], or none with a point.
pub fn lines(path: &Path, title: &str, axes: [&str; 2], scale: Scale, series: &[Series]) -> Result<()> {
    assert!(series.len() <= MAX_SERIES, "a chart of {} series has no colours for all", series.len());
    assert!(series.iter().any(|s| !s.points.is_empty()), "a chart of no points");
    draw!(path, area, unit, draw_lines(&area, unit, title, axes, scale, series))
}

/// Draws groups of bars: `groups` names along the horizontal axis, one bar of each series above each; `low` is where the
/// vertical axis begins.
///
/// # Errors
/// As [`lines`].
pub fn bars(
    path: &Path,
    title: &str,
    y: &str,
    groups: &[&str],
    series: &[(String, Vec<f64>)],
    low: f64,
) -> Result<()> {
    draw!(path, area, unit, draw_bars(&area, unit, title, y, groups, series, low))
}

fn draw_lines<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    unit: u32,
    title: &str,
    [x, y]: [&str; 2],
    scale: Scale,
    series: &[Series],
) -> Drawn
where
    B::ErrorType: 'static,
{
    let points = || series.iter().flat_map(|s| &s.points);
    let low = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = points().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let highest = points().map(|p| scale.height(p.1)).fold(f64::NEG_INFINITY, f64::max);
    let (bottom, top) = match scale {
        Scale::Linear => (0.0, 1.1 * highest),
        Scale::Percent => (0.0, 100.0),
        Scale::Logarithmic(least) => (least.log10(), highest.ceil()),
    };
    area.fill(&WHITE)?;
    let margin = 0.05 * (high - low);
    let margin = if scale == Scale::Percent { 0.0 } else { margin };
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 20 * unit))
        .margin(12 * unit)
        .x_label_area_size(44 * unit)
        .y_label_area_size(64 * unit)
        .build_cartesian_2d(low - margin..high + margin, bottom..top)?;
    let whole = (high - low).round() as usize + 1;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .x_labels(if scale == Scale::Percent { 16 } else { whole.clamp(2, 10) })
        .x_label_formatter(&|v| format!("{v:.0}"))
        .y_labels(match scale {
            Scale::Logarithmic(_) => (top - bottom).round() as usize + 1,
            _ => 10,
        })
        .label_style(("sans-serif", 12 * unit))
        .y_label_formatter(&|v| scale.label(*v))
        .light_line_style(WHITE)
        .draw()?;
    for (one, colour) in series.iter().zip(COLOURS) {
        chart
            .draw_series(
                LineSeries::new(
                    one.points.iter().map(|p| (p.0, scale.height(p.1))),
                    colour.stroke_width(2 * unit),
                )
                .point_size(if scale == Scale::Percent { 0 } else { 4 * unit }),
            )?
            .label(&one.name)
            .legend(move |(x, y)| {
                let end = x + 18 * unit as i32;
                PathElement::new([(x, y), (end, y)], colour.stroke_width(2 * unit))
            });
    }
    let corner = match scale {
        Scale::Percent => SeriesLabelPosition::LowerRight,
        _ => SeriesLabelPosition::MiddleRight,
    };
    chart
        .configure_series_labels()
        .position(corner)
        .label_font(("sans-serif", LEGEND * unit))
        .legend_area_size(30 * unit)
        .margin(10 * unit)
        .background_style(WHITE.mix(0.8))
        .border_style(FRAME)
        .draw()?;
    area.present()?;
    Ok(())
}

fn draw_bars<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    unit: u32,
    title: &str,
    y: &str,
    groups: &[&str],
    series: &[(String, Vec<f64>)],
    low: f64,
) -> Drawn
where
    B::ErrorType: 'static,
{
    let top = 1.08 * series.iter().flat_map(|s| &s.1).copied().fold(low, f64::max);
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 20 * unit))
        .margin(12 * unit)
        .x_label_area_size(44 * unit)
        .y_label_area_size(64 * unit)
        .build_cartesian_2d(-0.5..groups.len() as f64 - 0.5, low..top)?;
    chart
        .configure_mesh()
        .y_desc(y)
        .disable_x_mesh()
        .x_labels(2 * groups.len() + 1)
        .label_style(("sans-serif", 12 * unit))
        .x_label_formatter(&|v| {
            let nearest = v.round();
            let is_group = (v - nearest).abs() < 1e-6 && nearest >= 0.0;
            groups.get(nearest as usize).filter(|_| is_group).map_or(String::new(), |name| (*name).to_owned())
        })
        .light_line_style(WHITE)
        .draw()?;
    let width = 0.8 / series.len() as f64;
    for (s, ((name, heights), colour)) in series.iter().zip(COLOURS).enumerate() {
        let left = |group: usize| group as f64 - 0.4 + width * s as f64;
        let bar = |(g, &h): (usize, &f64)| {
            Rectangle::new([(left(g), low), (left(g) + 0.92 * width, h)], colour.filled())
        };
        chart.draw_series(heights.iter().enumerate().map(bar))?.label(name).legend(move |(x, y)| {
            let unit = unit as i32;
            Rectangle::new([(x, y - 5 * unit), (x + 14 * unit, y + 5 * unit)], colour.filled())
        });
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .label_font(("sans-serif", LEGEND * unit))
        .legend_area_size(30 * unit)
        .background_style(WHITE.mix(0.8))
        .border_style(FRAME)
        .draw()?;
    area.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series() -> [Series; 2] {
        let points = |slope: f64| (0..=15).map(|i| (f64::from(10 * i), slope * f64::from(i))).collect();
        [
            Series { name: "one".into(), points: points(2.0) },
            Series { name: "other".into(), points: points(6.0) },
        ]
    }

    #[test]
    fn both_formats_show_every_line_and_the_same_input_gives_the_same_bytes() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [svg, png, again] = ["a.svg", "a.png", "b.png"].map(|name| folder.path().join(name));
        for path in [&svg, &png, &again] {
            lines(path, "title", ["x", "y"], Scale::Percent, &series()).expect("a chart");
        }
        let text = std::fs::read_to_string(&svg).expect("a text");
        assert!(["title", "one", "other", "#0072B2", "#D55E00"].iter().all(|words| text.contains(words)));
        let bytes = |path| std::fs::read(path).expect("a file");
        assert_eq!(bytes(&png), bytes(&again));
        let image = picture::read_rgb(&png, Some((1440, 880))).expect("a picture");
        for colour in &COLOURS[..2] {
            let count = image.pixels().filter(|p| p.0 == [colour.0, colour.1, colour.2]).count();
            assert!(count > 1000, "{colour:?}: {count} pixels");
        }
    }

    #[test]
    fn bars_are_drawn_in_both_formats() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["bars.svg", "bars.png"] {
            let path = folder.path().join(name);
            let rows = [("a".to_owned(), vec![1.0, 2.0]), ("b".to_owned(), vec![3.0, 1.0])];
            bars(&path, "title", "mm", &["front", "back"], &rows, 0.0).expect("a chart");
            assert!(std::fs::metadata(&path).expect("a file").len() > 1000);
        }
    }

    #[test]
    fn other_formats_are_refused_by_name() {
        let refusal = check_path(Path::new("curve.pdf")).expect_err("no chart is a PDF").to_string();
        assert_eq!(refusal, "curve.pdf: a chart is written as .svg or .png");
    }
}
