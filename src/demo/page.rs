//! One page without scripts or addresses outside its folder: the tables, the pictures, the files.

use super::Results;
use crate::evaluate::surfaces::Sampling;

const STYLE: &str = "\
body{font:16px/1.5 system-ui,sans-serif;max-width:76rem;margin:2rem auto;padding:0 1rem;color:#222;background:#fff}
h1{margin-bottom:0}table{border-collapse:collapse;margin:1rem 0}td,th{padding:.2rem .8rem;text-align:right;font-variant-numeric:tabular-nums}
td:first-child,th:first-child{text-align:left}tr{border-bottom:1px solid #ddd}img{max-width:100%}p{max-width:46rem}";

/// The page for results whose pictures lie beside it.
pub fn page(results: &Results) -> String {
    let cameras = results.done.views.len();
    let lattice = results.done.found.coarse.field.resolution;
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>Vitruvian demo</title>\n<style>\n{STYLE}\n</style>\n\
         <h1>A body from {cameras} photographs</h1>\n\
         <p>A person with seed {seed} was made up and photographed. A body was fitted to its keypoints, which are exact here, \
         and to its masks: its joints are {joints:.2} mm from the true ones. From the photographs, masks and cameras alone, MF-PIFu \
         found the coarse surface and voxel super-resolution refined it, each on a lattice of {lattice} cells along a \
         side. The true surface was used only to measure.</p>\n\
         <h2>How far from the truth</h2>\n{surfaces}\n\
         <p>P2S: mean distance from the surface to the true one. Largest piece: the same without stray pieces. Complete: mean \
         distance the other way. Chamfer-L2: mean of the squared distances both ways. Normals: mean |cos| between \
         normals. IoU: shared volume over united volume. Points asked: the share of the lattice's points that the network \
         was asked for. {sampling}.</p>\n\
         <h2>Pictures</h2>\n<img src=\"preview.png\" alt=\"Rows: input views; coarse surface; refined surface; true surface; \
         refined surface coloured by its distance from the truth\">\n\
         <p>The fitted body over the photographs; red: keypoints, blue: where the body has them.</p>\n{overlays}\n{regressed}\
         <h2>Time</h2>\n{times}\n\
         <h2>Files</h2>\n<p>{files}</p>\n</html>\n",
        seed = results.seed,
        joints = results.fitted.joint_error_mm,
        overlays = overlays(results, "fit"),
        regressed = regressed(results),
        surfaces = html_table(&Results::surface_head(), &results.surface_rows()),
        times = html_table(&["stage", "seconds"], &results.time_rows()),
        sampling = Sampling::default().words(),
        files = [
            "fit/body.ply",
            "fit/params.npz",
            "coarse.ply",
            "refined.ply",
            "capture/mesh.obj",
            "capture/cameras.json",
            "preview.png",
            "report.json"
        ]
        .map(|file| format!("<a href=\"{file}\">{file}</a>"))
        .join(" · "),
    )
}

fn overlays(results: &Results, folder: &str) -> String {
    let picture = |name: &str| {
        format!("<img src=\"{folder}/overlay_{name}.png\" alt=\"camera {name}\" style=\"max-width:24%\">")
    };
    results.done.views.iter().map(|view| picture(&view.camera.name)).collect()
}

/// The regressed bodies, where there is a regressor.
fn regressed(results: &Results) -> String {
    results.regressed.map_or(String::new(), |errors| {
        format!(
            "<p>The body that the regressor sees in each photograph by itself; its joints are {:.1} mm from the true ones \
             (MPJPE), {:.1} mm after alignment (PA-MPJPE). The frame is what it was shown.</p>\n{}\n\
             <p><a href=\"regress/params.npz\">regress/params.npz</a> · <a href=\"regress/report.json\">regress/report.json</a></p>\n",
            errors.mpjpe_mm,
            errors.pa_mpjpe_mm,
            overlays(results, "regress")
        )
    })
}

fn html_table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
        let cells: String = cells.map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
        format!("<tr>{cells}</tr>")
    };
    let mut lines = vec![line("th", &mut head.iter().copied())];
    lines.extend(rows.iter().map(|row| line("td", &mut row.iter().map(String::as_str))));
    format!("<table>\n{}\n</table>", lines.join("\n"))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_row_for_the_head_and_each_row_with_its_marks_escaped() {
        let table = html_table(&["a", "b"], &[vec!["<1>".into(), "2 & 3".into()]]);
        assert_eq!(
            table,
            "<table>\n<tr><th>a</th><th>b</th></tr>\n<tr><td>&lt;1&gt;</td><td>2 &amp; 3</td></tr>\n</table>"
        );
    }
}
