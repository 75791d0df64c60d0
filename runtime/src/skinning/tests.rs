use super::*;
use crate::rotation::rotation_minus_identity;
use std::f64::consts::{FRAC_PI_2, PI};

/// Three vertices on two bones; one beta lengthens the second; a quarter turn of joint 1 about z lifts the last vertex.
fn two_bones() -> BodyArrays {
    let mut shapedirs = vec![0.0; 9];
    shapedirs[6] = 1.0;
    let mut posedirs = vec![0.0; 81];
    posedirs[(3 * 2 + 1) * 9] = -1.0;
    BodyArrays {
        v_template: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
        faces: vec![[0, 1, 2]],
        shapedirs,
        posedirs,
        j_regressor: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        lbs_weights: vec![1.0, 0.0, 0.5, 0.5, 0.0, 1.0],
        parents: vec![None, Some(0)],
    }
}

fn close(found: [f64; 3], expected: [f64; 3], bound: f64) {
    for axis in 0..3 {
        assert!((found[axis] - expected[axis]).abs() <= bound, "{found:?}, expected {expected:?}");
    }
}

#[test]
fn forward_kinematics_by_hand_and_far_from_the_origin() {
    let skinner = Skinner::new(&two_bones()).unwrap();
    let pose = [0.0, 0.0, FRAC_PI_2, 0.0, 0.0, FRAC_PI_2];
    let trans = [0.0, 1e6, 3.0];
    let posed = skinner.pose(&[Frame { pose: &pose, betas: &[0.5], trans, offsets: &[] }]).unwrap();
    let expected = [[0.0, 1e6, 3.0], [0.0, 1e6 + 1.0, 3.0], [-1.5, 1e6, 3.0]];
    for (v, e) in posed[0].vertices.iter().zip(expected) {
        close(*v, e, 1e-6);
    }
    close(posed[0].joints[1], [0.0, 1e6 + 1.0, 3.0], 1e-9);
}

#[test]
fn every_frame_of_a_batch_is_what_it_is_alone() {
    let skinner = Skinner::new(&two_bones()).unwrap();
    let poses: Vec<Vec<f64>> =
        (0..19).map(|f| (0..6).map(|n| f64::from(f * n) * 0.37 - 3.0).collect()).collect();
    let betas: Vec<[f64; 1]> = (0..19).map(|f| [f64::from(f / 5) * 0.3]).collect();
    let offsets = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]];
    let frames: Vec<Frame<'_>> = poses
        .iter()
        .zip(&betas)
        .enumerate()
        .map(|(f, (pose, betas))| Frame {
            pose,
            betas,
            trans: [f as f64, 0.0, -1.0],
            offsets: if f % 3 == 0 { &offsets } else { &[] },
        })
        .collect();
    let together = skinner.pose(&frames).unwrap();
    assert_eq!(together.len(), 19);
    for (frame, posed) in frames.iter().zip(&together) {
        assert_eq!(skinner.pose(&[*frame]).unwrap()[0], *posed);
    }
    assert!(skinner.pose(&[]).unwrap().is_empty());
}

#[test]
fn turns_of_any_size_keep_their_digits() {
    let small = rotation_minus_identity([1e-4, 0.0, 0.0]);
    assert!((small[1][1] / -5e-9 - 1.0).abs() < 1e-8 && (small[2][1] / 1e-4 - 1.0).abs() < 2e-9, "{small:?}");
    let (many, one) = (
        rotation_minus_identity([0.0, 0.0, 2.0 * PI * 159.0 + 1.0]),
        rotation_minus_identity([0.0, 0.0, 1.0]),
    );
    for (a, b) in many.as_flattened().iter().zip(one.as_flattened()) {
        assert!((a - b).abs() < 1e-12, "{many:?} {one:?}");
    }
    for huge in [1e200, f64::MAX, f64::MIN_POSITIVE] {
        let r = rotation_minus_identity([huge, -huge, 0.5 * huge]);
        assert!(r.as_flattened().iter().all(|x| x.abs() <= 2.0), "{huge}: {r:?}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_both_numbers() {
    let skinner = Skinner::new(&two_bones()).unwrap();
    let good = Frame { pose: &[0.0; 6], betas: &[], trans: [0.0; 3], offsets: &[] };
    let refusal = |frame: Frame<'_>| skinner.pose(&[good, frame]).unwrap_err().to_string();
    assert_eq!(
        refusal(Frame { pose: &[0.0; 5], ..good }),
        "frame 1: the pose has 5 numbers; the body takes 6"
    );
    assert!(refusal(Frame { betas: &[0.0; 2], ..good }).contains("there are 2 betas; the body has 1"));
    assert!(refusal(Frame { offsets: &[[0.0; 3]], ..good }).contains("1 offsets; the body has 3 vertices"));
    assert!(refusal(Frame { trans: [f64::NAN; 3], ..good }).contains("not finite"));
    assert!(refusal(Frame { betas: &[1e300], ..good }).contains("vertex 2"));
    let refused = |spoil: fn(&mut BodyArrays)| {
        let mut body = two_bones();
        spoil(&mut body);
        Skinner::new(&body).err().map(|error| error.to_string()).unwrap_or_default()
    };
    assert!(
        refused(|b| {
            b.posedirs.pop();
        })
        .contains("posedirs has 80 numbers")
    );
    assert!(refused(|b| b.lbs_weights[0] = f64::NAN).contains("weights holds NaN"));
    assert!(refused(|b| b.parents[1] = Some(1)).contains("joint 1 has the parent Some(1)"));
    assert!(refused(|b| b.v_template.clear()).contains("0 vertices"));
}
