//! Line and bar charts as SVG files.

use std::error::Error;
use std::path::Path;

use plotters::prelude::*;

/// Width and height of a chart in pixels.
const SIZE: (u32, u32) = (720, 440);

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

/// A named row of points.
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

/// The vertical axis of a chart of lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From 0.
    Linear,
    /// In powers of ten from this value, at which smaller ones are drawn.
    Logarithmic(f64),
}

impl Scale {
    fn height(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Logarithmic(least) => value.max(least).log10(),
        }
    }

    fn label(self, height: f64) -> String {
        match self {
            Scale::Linear => format!("{height:.2}"),
            Scale::Logarithmic(_) => format!("{}", 10f64.powf(height)),
        }
    }
}

/// Draws `series` as lines with marked points.
pub fn lines(
    path: &Path,
    title: &str,
    [x, y]: [&str; 2],
    scale: Scale,
    series: &[Series],
) -> Result<(), Box<dyn Error>> {
    assert!(series.len() < COLOURS.len(), "a chart of {} series has no colours for all", series.len());
    let points = || series.iter().flat_map(|s| &s.points);
    let low = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = points().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let highest = points().map(|p| scale.height(p.1)).fold(f64::NEG_INFINITY, f64::max);
    let (bottom, top) = match scale {
        Scale::Linear => (0.0, 1.1 * highest),
        Scale::Logarithmic(least) => (least.log10(), highest.ceil()),
    };
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let margin = 0.05 * (high - low);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(low - margin..high + margin, bottom..top)?;
    let whole = (high - low).round() as usize + 1;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .x_labels(whole.clamp(2, 10))
        .x_label_formatter(&|v| format!("{v:.0}"))
        .y_labels(if scale == Scale::Linear { 10 } else { (top - bottom).round() as usize + 1 })
        .y_label_formatter(&|v| scale.label(*v))
        .light_line_style(WHITE)
        .draw()?;
    for (one, colour) in series.iter().zip(COLOURS) {
        chart
            .draw_series(
                LineSeries::new(one.points.iter().map(|p| (p.0, scale.height(p.1))), colour.stroke_width(2))
                    .point_size(4),
            )?
            .label(&one.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(FRAME).draw()?;
    area.present()?;
    Ok(())
}

/// Draws groups of bars: `groups` names along the horizontal axis, one bar of each series above each; `low` is where the
/// vertical axis begins.
pub fn bars(
    path: &Path,
    title: &str,
    y: &str,
    groups: &[&str],
    series: &[(String, Vec<f64>)],
    low: f64,
) -> Result<(), Box<dyn Error>> {
    let top = 1.08 * series.iter().flat_map(|s| &s.1).copied().fold(low, f64::max);
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(-0.5..groups.len() as f64 - 0.5, low..top)?;
    chart
        .configure_mesh()
        .y_desc(y)
        .disable_x_mesh()
        .x_labels(2 * groups.len() + 1)
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
        chart
            .draw_series(heights.iter().enumerate().map(bar))?
            .label(name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(FRAME)
        .draw()?;
    area.present()?;
    Ok(())
}
