//! Evaluations of joints as text and as JSON.

use std::path::Path;

use serde_json::{Map, Value, json};
use vitruvian_reference::metric::pck::{PCK_THRESHOLD_M, pck, thresholds_m};

use super::Evaluation;
use super::measures::{Errors, Measures, Row, Rows, mean, median};
use crate::evaluate::{Findings, sides};
use crate::table;

/// The table, the same for machines, and what the bounds judge: the worst of several predictions.
pub fn findings(evaluations: &[Evaluation], truth: &Path, per_joint: bool) -> Findings {
    let totals: Vec<Measures> = evaluations.iter().map(total).collect();
    let worst = |of: fn(&Measures) -> f64| totals.iter().map(of).reduce(f64::max);
    let (text, json) = match evaluations {
        [only] => (text_of_one(only, &totals[0], per_joint), json_of(only)),
        _ => (text_of_several(evaluations, &totals, per_joint), several(evaluations, truth)),
    };
    Findings {
        mpjpe_mm: worst(|m| m.mpjpe_mm),
        pa_mpjpe_mm: worst(|m| m.pa_mpjpe_mm),
        ..Findings::new(text, json)
    }
}

/// The measures of all frames; of captures their mean, so that each counts the same.
fn total(evaluation: &Evaluation) -> Measures {
    match &evaluation.rows {
        Rows::Captures(captures, _) => Measures::over(&of_rows(captures), mean),
        Rows::None | Rows::Views(_) => evaluation.errors.measures(),
    }
}

fn of_rows(rows: &[Row]) -> Vec<Measures> {
    rows.iter().map(|(_, errors)| errors.measures()).collect()
}

fn line(name: &str, measures: &Measures) -> Vec<String> {
    [vec![name.to_owned()], measures.cells()].concat()
}

fn head(first: &'static str) -> Vec<&'static str> {
    [&[first][..], &Measures::HEAD].concat()
}

fn text_of_one(evaluation: &Evaluation, total: &Measures, per_joint: bool) -> String {
    let lines = |rows: &[Row]| -> Vec<Vec<String>> {
        rows.iter().map(|(name, errors)| line(name, &errors.measures())).collect()
    };
    let mut parts = vec![match &evaluation.rows {
        Rows::None => {
            let name = |head: &str| head.trim_end_matches(" mm").trim_end_matches(" %").to_owned();
            let unit = |head: &str| if head.ends_with('%') { "%" } else { "mm" };
            let row = |(head, cell): (&&str, String)| format!("{:<12}{cell:>8} {}", name(head), unit(head));
            Measures::HEAD.iter().zip(total.cells()).map(row).collect::<Vec<_>>().join("\n")
        }
        Rows::Views(views) => {
            let mut lines = lines(views);
            lines.push(line("mean", total));
            table::aligned(&head("view"), &lines)
        }
        Rows::Captures(captures, _) => {
            let mut lines = lines(captures);
            lines.push(line("mean", total));
            lines.push(line("median", &Measures::over(&of_rows(captures), median)));
            table::aligned(&head("capture"), &lines)
        }
    }];
    parts.push(foot(evaluation, total));
    parts.extend(without_result(evaluation));
    if per_joint {
        parts.push(joints_table(evaluation));
    }
    parts.join("\n")
}

fn text_of_several(evaluations: &[Evaluation], totals: &[Measures], per_joint: bool) -> String {
    let lines: Vec<Vec<String>> =
        evaluations.iter().zip(totals).map(|(evaluation, total)| line(&evaluation.label, total)).collect();
    let mut parts = vec![table::aligned(&head("predicted"), &lines)];
    let feet: Vec<String> = evaluations.iter().zip(totals).map(|(one, total)| foot(one, total)).collect();
    let are_alike = feet.iter().all(|foot| *foot == feet[0]);
    for (index, (evaluation, foot)) in evaluations.iter().zip(feet).enumerate() {
        if !are_alike {
            parts.push(format!("{}: {foot}", evaluation.label));
        } else if index == 0 {
            parts.push(foot);
        }
        parts.extend(without_result(evaluation).map(|words| format!("{}: {words}", evaluation.label)));
        if per_joint {
            parts.push(format!("{}:\n{}", evaluation.label, joints_table(evaluation)));
        }
    }
    parts.join("\n")
}

fn foot(evaluation: &Evaluation, total: &Measures) -> String {
    let super::pairing::Description { sets, root, .. } = &evaluation.pair;
    format!("{} frames of {} joints ({sets}), relative to {root}", total.frames, total.joints)
}

/// A word about captures that nothing was predicted for: the means are not of them.
fn without_result(evaluation: &Evaluation) -> Option<String> {
    match &evaluation.rows {
        Rows::Captures(_, missing) if !missing.is_empty() => {
            Some(format!("{} captures without a result: {}", missing.len(), missing.join(", ")))
        }
        _ => None,
    }
}

/// Per joint: name, MPJPE, PA-MPJPE (mm), PCK@150, PA PCK@150 (%).
fn per_joint(evaluation: &Evaluation) -> Vec<(&str, [f64; 4])> {
    let Errors { relative, aligned, .. } = &evaluation.errors;
    let (mpjpe, pa_mpjpe) = (relative.per_joint(), aligned.per_joint());
    let correct = |errors: Vec<f64>| pck(&errors, PCK_THRESHOLD_M);
    let names = evaluation.pair.names.iter().enumerate();
    names
        .map(|(j, name)| {
            let share = [correct(relative.of_joint(j)), correct(aligned.of_joint(j))];
            (name.as_str(), [1000.0 * mpjpe[j], 1000.0 * pa_mpjpe[j], share[0], share[1]])
        })
        .collect()
}

fn joints_table(evaluation: &Evaluation) -> String {
    let line = |(name, values): (&str, [f64; 4])| {
        [vec![name.to_owned()], values.map(|x| format!("{x:.1}")).to_vec()].concat()
    };
    let lines: Vec<Vec<String>> = per_joint(evaluation).into_iter().map(line).collect();
    table::aligned(&["joint", "MPJPE mm", "PA-MPJPE mm", "PCK@150 %", "PA PCK@150 %"], &lines)
}

fn json_of(evaluation: &Evaluation) -> Value {
    let mut object = Map::new();
    object.insert("files".into(), sides(&evaluation.predicted, &evaluation.truth));
    object.insert("measures".into(), json!(total(evaluation)));
    object.insert("joint_set".into(), json!(evaluation.pair.sets));
    object.insert("root".into(), json!(evaluation.pair.root));
    let rows = |rows: &[Row]| -> Value {
        rows.iter()
            .map(|(name, errors)| (name.clone(), json!(errors.measures())))
            .collect::<Map<_, _>>()
            .into()
    };
    match &evaluation.rows {
        Rows::None => {}
        Rows::Views(views) => {
            object.insert("views".into(), rows(views));
        }
        Rows::Captures(captures, missing) => {
            object.insert("captures".into(), rows(captures));
            object.insert("median".into(), json!(Measures::over(&of_rows(captures), median)));
            object.insert("without_result".into(), json!(missing));
        }
    }
    let joints = per_joint(evaluation).into_iter().map(|(name, [mpjpe, pa_mpjpe, pck, pa_pck])| {
        json!({
            "name": name,
            "mpjpe_mm": mpjpe,
            "pa_mpjpe_mm": pa_mpjpe,
            "pck_150": pck,
            "pa_pck_150": pa_pck,
        })
    });
    object.insert("per_joint".into(), joints.collect());
    let Errors { relative, aligned, .. } = &evaluation.errors;
    object.insert(
        "curve".into(),
        json!({
            "threshold_mm": thresholds_m().map(|threshold| (1000.0 * threshold).round()),
            "pck": relative.pck_curve(),
            "pa_pck": aligned.pck_curve(),
        }),
    );
    object.into()
}

fn several(evaluations: &[Evaluation], truth: &Path) -> Value {
    let each = evaluations.iter().map(|evaluation| {
        let mut value = json_of(evaluation);
        value["label"] = json!(evaluation.label);
        value
    });
    json!({ "truth": truth.display().to_string(), "predicted": each.collect::<Vec<_>>() })
}
