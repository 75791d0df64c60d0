//! The forward model once more, in other words: quaternions, 4×4 matrices, every sum in full.

use vitruvian_reference::body::{BodyModel, Posed};
use vitruvian_reference::linalg::vector::Vector3;

type Matrix4 = [[f64; 4]; 4];

/// The rotation by way of the unit quaternion (cos ½α, sin ½α · n), and the translation `t`.
fn rigid(axis_angle: &[f64], t: Vector3) -> Matrix4 {
    let angle = axis_angle.iter().map(|x| x * x).sum::<f64>().sqrt();
    let w = (0.5 * angle).cos();
    let [x, y, z] =
        std::array::from_fn(|i| if angle == 0.0 { 0.0 } else { (0.5 * angle).sin() * axis_angle[i] / angle });
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y), t[0]],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x), t[1]],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y), t[2]],
        [0.0, 0.0, 0.0, 1.0],
    ]
}

fn product(a: &Matrix4, b: &Matrix4) -> Matrix4 {
    std::array::from_fn(|r| std::array::from_fn(|c| (0..4).map(|k| a[r][k] * b[k][c]).sum()))
}

/// `body.pose(pose, betas, trans)`.
pub fn plain_pose(body: &BodyModel, pose: &[f64], betas: &[f64], trans: Vector3) -> Posed {
    let (v, j, b) =
        (body.v_template.len(), body.parents.len(), body.shapedirs.len() / (3 * body.v_template.len()));
    let p = 9 * (j - 1);
    let mut rest: Vec<Vector3> = body.v_template.clone();
    for (i, vertex) in rest.iter_mut().enumerate() {
        for axis in 0..3 {
            for (l, beta) in betas.iter().enumerate() {
                vertex[axis] += beta * body.shapedirs[(3 * i + axis) * b + l];
            }
        }
    }
    let joints: Vec<Vector3> = (0..j)
        .map(|k| {
            std::array::from_fn(|axis| (0..v).map(|i| body.j_regressor[k * v + i] * rest[i][axis]).sum())
        })
        .collect();

    let mut global: Vec<Matrix4> = Vec::new();
    let mut feature = Vec::new();
    for k in 0..j {
        let vector = &pose[3 * k..3 * k + 3];
        match body.parents[k] {
            None => global.push(rigid(vector, joints[k])),
            Some(parent) => {
                let bone = std::array::from_fn(|axis| joints[k][axis] - joints[parent][axis]);
                let local = rigid(vector, bone);
                global.push(product(&global[parent], &local));
                feature.extend((0..9).map(|n| local[n / 3][n % 3] - f64::from(u8::from(n % 4 == 0))));
            }
        }
    }
    let relative: Vec<Matrix4> =
        (0..j).map(|k| product(&global[k], &rigid(&[0.0; 3], joints[k].map(|x| -x)))).collect();

    let vertices = (0..v)
        .map(|i| {
            let x: Vector3 = std::array::from_fn(|axis| {
                let directions = &body.posedirs[(3 * i + axis) * p..(3 * i + axis + 1) * p];
                rest[i][axis] + directions.iter().zip(&feature).map(|(d, f)| d * f).sum::<f64>()
            });
            let weights = &body.lbs_weights[i * j..(i + 1) * j];
            std::array::from_fn(|r| {
                let blended = |c: usize| -> f64 { (0..j).map(|k| weights[k] * relative[k][r][c]).sum() };
                blended(0) * x[0] + blended(1) * x[1] + blended(2) * x[2] + blended(3) + trans[r]
            })
        })
        .collect();
    let posed = |g: &Matrix4| std::array::from_fn(|r| g[r][3] + trans[r]);
    Posed { vertices, joints: global.iter().map(posed).collect() }
}
