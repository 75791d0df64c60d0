//! Bodies: how far joints and vertices move, in millimetres, and their pictures, in pixels of the crop.

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::body::mannequin::JOINT_NAMES;
use vitruvian_reference::camera::WeakPerspective;
use vitruvian_reference::linalg::matrix::Matrix3;
use vitruvian_reference::linalg::svd::nearest_rotation;
use vitruvian_reference::linalg::vector::{Vector3, distance, sub};
use vitruvian_reference::metric::joints::{mpjpe, pa_mpjpe};
use vitruvian_reference::nn::Tensor;
use vitruvian_reference::rotation::{from_six_d, logarithm};
use vitruvian_runtime::contract::PoseForm;

use super::{Displacement, Outputs, Ruler, output};
use crate::audit::variant::report::{BodyReport, Geometry, Summary, View, WorstJoint, WorstVertex};

/// Metres to millimetres.
const MM: f64 = 1000.0;

/// Where bodies come from.
#[derive(Clone, Debug)]
pub enum Source {
    /// Outputs `vertices` N×V×3 and `joints` N×J×3, metres.
    Points {
        /// Triangles, where they are known.
        faces: Vec<[u32; 3]>,
    },
    /// Outputs `pose`, `betas` and `camera` of a regressor, posed by a body.
    Parameters {
        /// The body, 24 joints; betas beyond its own are left out.
        body: Box<BodyModel>,
        /// What the body is called.
        name: String,
        /// How the pose is written.
        form: PoseForm,
        /// The camera's focal length in pixels of the crop.
        focal_px: f64,
        /// S, the crop's side in pixels.
        side_px: f64,
    },
}

/// One body in space, and in its picture where there is a camera.
#[derive(Clone, Debug, PartialEq)]
struct Figure {
    vertices: Vec<Vector3>,
    joints: Vec<Vector3>,
    /// The camera's translation and the joints in pixels of the crop; NaN where a joint is behind the camera.
    picture: Option<(Vector3, Vec<[f64; 2]>)>,
}

/// Bodies of the base, in the order of inputs and of the batch.
#[derive(Debug)]
pub struct BodyRuler {
    source: Source,
    base: Vec<Figure>,
}

impl BodyRuler {
    /// A ruler on the base's outputs.
    ///
    /// # Errors
    /// When an output is missing, has another shape than its meaning asks for, or is not finite: a base must be a body.
    pub fn new(source: Source, base: &[Outputs]) -> Result<Self, String> {
        let figures = source.figures(base)?;
        let whole =
            |figure: &Figure| figure.vertices.iter().chain(&figure.joints).flatten().all(|x| x.is_finite());
        match figures.iter().position(|figure| !whole(figure)) {
            Some(i) => Err(format!("the base's body {i} is not finite")),
            None if figures.is_empty() => Err("the base gave no bodies".to_owned()),
            None => Ok(Self { source, base: figures }),
        }
    }

    /// The variant's bodies, as many and as large as the base's.
    fn others(&self, variant: &[Outputs]) -> Result<Vec<Figure>, String> {
        let others = self.source.figures(variant)?;
        let size = |figures: &[Figure]| -> Vec<_> {
            figures.iter().map(|figure| (figure.vertices.len(), figure.joints.len())).collect()
        };
        if size(&self.base) == size(&others) {
            Ok(others)
        } else {
            Err("the variant's bodies differ in number or in their numbers of vertices and joints".to_owned())
        }
    }

    fn vertex_distances(&self, others: &[Figure]) -> Vec<f64> {
        let pairs = self.base.iter().zip(others);
        pairs.flat_map(|(a, b)| distances_mm(&a.vertices, &b.vertices)).collect()
    }
}

impl Ruler for BodyRuler {
    fn unit(&self) -> &'static str {
        "mm of the vertices"
    }

    fn displacement(&self, variant: &[Outputs]) -> Result<Displacement, String> {
        let others = self.others(variant)?;
        let pairs = self.base.iter().zip(&others);
        let components = pairs
            .flat_map(|(a, b)| a.vertices.iter().zip(&b.vertices).flat_map(|(&p, &q)| sub(q, p)))
            .map(|metres| MM * metres)
            .collect();
        Ok(Displacement { components, lengths: Summary::of(&self.vertex_distances(&others)) })
    }

    fn report(&self, variant: &[Outputs]) -> Result<(Geometry, Option<Summary>), String> {
        let others = self.others(variant)?;
        let vertex = self.vertex_distances(&others);
        let joint: Vec<f64> =
            self.base.iter().zip(&others).flat_map(|(a, b)| distances_mm(&a.joints, &b.joints)).collect();
        let (vertices, joints) = (Summary::of(&vertex), Summary::of(&joint));
        // Of bodies that are not finite nothing more is measured: no similarity brings them anywhere.
        let mean = |error: &dyn Fn(&[Vector3], &[Vector3]) -> f64| {
            let errors = self.base.iter().zip(&others).map(|(a, b)| error(&b.joints, &a.joints));
            joints.map(|_| MM * errors.sum::<f64>() / self.base.len() as f64)
        };
        let pictures: Vec<_> = self
            .base
            .iter()
            .zip(&others)
            .filter_map(|(a, b)| Some((a.picture.as_ref()?, b.picture.as_ref()?)))
            .collect();
        let pixels: Vec<f64> = pictures
            .iter()
            .flat_map(|((_, a), (_, b))| a.iter().zip(b).map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1])))
            .collect();
        let cameras: Vec<f64> = pictures.iter().map(|((a, _), (b, _))| MM * distance(*a, *b)).collect();
        let report = BodyReport {
            body: self.source.words(),
            bodies: self.base.len(),
            mpjpe: mean(&|estimate, truth| mpjpe(estimate, truth, 0)),
            pa_mpjpe: mean(&pa_mpjpe),
            joints,
            vertices,
            worst_vertex: worst(&vertex).map(|(place, millimetres)| self.worst_vertex(place, millimetres)),
            worst_joint: worst(&joint).map(|worst| self.worst_joint(worst)),
            reprojection_px: Summary::of(&pixels),
            camera: Summary::of(&cameras),
        };
        // A body without vertices is measured by its joints.
        let distances = if vertex.is_empty() { joints } else { vertices };
        Ok((Geometry::Body(report), distances))
    }

    fn view(&self, variant: &[Outputs]) -> Result<Option<View>, String> {
        let others = self.others(variant)?;
        let Some(faces) = self.source.faces().filter(|faces| !faces.is_empty()) else { return Ok(None) };
        let largest = |i: usize| {
            let errors = distances_mm(&self.base[i].vertices, &others[i].vertices);
            errors.into_iter().fold(0.0, f64::max)
        };
        let Some(body) = (0..self.base.len()).max_by(|&a, &b| largest(a).total_cmp(&largest(b))) else {
            return Ok(None);
        };
        let base = &self.base[body];
        if faces.iter().flatten().any(|&vertex| vertex as usize >= base.vertices.len()) {
            return Ok(None);
        }
        let errors = distances_mm(&base.vertices, &others[body].vertices);
        if errors.iter().any(|e| !e.is_finite()) {
            return Ok(None);
        }
        Ok(Some(View {
            title: format!("body {body} of the base, coloured by how far the variant's vertices are"),
            vertices: base.vertices.iter().map(|v| v.map(|x| x as f32)).collect(),
            faces: faces.to_vec(),
            millimetres: errors.into_iter().map(|e| e as f32).collect(),
        }))
    }
}

impl BodyRuler {
    /// The vertex at a place counted through all bodies.
    fn worst_vertex(&self, place: usize, millimetres: f64) -> WorstVertex {
        let count = self.base[0].vertices.len();
        let (body, vertex) = (place / count, place % count);
        let joint = match &self.source {
            Source::Parameters { body, .. } => {
                let j = body.joint_count();
                let row = &body.lbs_weights[vertex * j..(vertex + 1) * j];
                (0..j).max_by(|&a, &b| row[a].total_cmp(&row[b])).map(joint_name)
            }
            Source::Points { .. } => None,
        };
        WorstVertex { vertex, body, at: self.base[body].vertices[vertex], millimetres, joint }
    }

    fn worst_joint(&self, (place, millimetres): (usize, f64)) -> WorstJoint {
        let count = self.base[0].joints.len();
        let (body, joint) = (place / count, place % count);
        let joint = if count == JOINT_NAMES.len() { joint_name(joint) } else { joint.to_string() };
        WorstJoint { joint, body, millimetres }
    }
}

impl Source {
    fn words(&self) -> String {
        match self {
            Source::Points { .. } => "the graph's own vertices and joints".to_owned(),
            Source::Parameters { name, .. } => format!("{name}, posed by the graph's pose and betas"),
        }
    }

    fn faces(&self) -> Option<&[[u32; 3]]> {
        match self {
            Source::Points { faces } => Some(faces),
            Source::Parameters { body, .. } => Some(&body.faces),
        }
    }

    fn figures(&self, runs: &[Outputs]) -> Result<Vec<Figure>, String> {
        let each: Result<Vec<Vec<Figure>>, String> =
            runs.iter().map(|outputs| self.of_run(outputs)).collect();
        Ok(each?.into_iter().flatten().collect())
    }

    fn of_run(&self, outputs: &Outputs) -> Result<Vec<Figure>, String> {
        match self {
            Source::Points { .. } => {
                let vertices = clouds("vertices", output(outputs, "vertices")?)?;
                let joints = clouds("joints", output(outputs, "joints")?)?;
                if vertices.len() != joints.len() || joints.iter().any(Vec::is_empty) {
                    return Err(format!(
                        "outputs \"vertices\" and \"joints\" hold {} and {} bodies, or bodies without joints",
                        vertices.len(),
                        joints.len()
                    ));
                }
                let figure = |(vertices, joints)| Figure { vertices, joints, picture: None };
                Ok(vertices.into_iter().zip(joints).map(figure).collect())
            }
            Source::Parameters { body, form, focal_px, side_px, .. } => {
                let pose = rows("pose", output(outputs, "pose")?, Some(24 * form.width()))?;
                let betas = rows("betas", output(outputs, "betas")?, None)?;
                let camera = rows("camera", output(outputs, "camera")?, Some(3))?;
                if pose.len() != betas.len() || pose.len() != camera.len() {
                    return Err(
                        "outputs \"pose\", \"betas\" and \"camera\" differ in their first side".to_owned()
                    );
                }
                let places = 0..pose.len();
                Ok(places
                    .map(|i| posed(body, *form, pose[i], betas[i], camera[i], *focal_px, *side_px))
                    .collect())
            }
        }
    }
}

/// The body of one row of a regressor's outputs; NaN throughout where they mean none.
fn posed(
    body: &BodyModel,
    form: PoseForm,
    pose: &[f64],
    betas: &[f64],
    camera: &[f64],
    focal_px: f64,
    side_px: f64,
) -> Figure {
    let rotations: Option<Vec<Vector3>> =
        pose.chunks_exact(form.width()).map(|numbers| axis_angle(form, numbers)).collect();
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    let (vertices, joints) = match rotations {
        Some(rotations) if finite(betas) => {
            let pose: Vec<f64> = rotations.into_iter().flatten().collect();
            let known = &betas[..betas.len().min(body.beta_count())];
            let posed = body.pose(&pose, known, [0.0; 3]);
            (posed.vertices, posed.joints)
        }
        _ => (vec![[f64::NAN; 3]; body.vertex_count()], vec![[f64::NAN; 3]; body.joint_count()]),
    };
    let [scale, t_x, t_y] = [camera[0], camera[1], camera[2]];
    let view = WeakPerspective { scale, translation: [t_x, t_y], focal_px, side_px };
    let pixel = |joint: &Vector3| match view.project(*joint) {
        Some(unit) => unit.map(|c| 0.5 * side_px * (c + 1.0)),
        None => [f64::NAN; 2],
    };
    let picture = Some(([t_x, t_y, view.depth_m()], joints.iter().map(pixel).collect()));
    Figure { vertices, joints, picture }
}

/// One joint's rotation as an axis–angle vector; `None` where the numbers mean none.
fn axis_angle(form: PoseForm, x: &[f64]) -> Option<Vector3> {
    if x.iter().any(|x| !x.is_finite()) {
        return None;
    }
    match form {
        PoseForm::AxisAngle => Some([x[0], x[1], x[2]]),
        PoseForm::SixD => from_six_d(&std::array::from_fn(|i| x[i])).map(|r| logarithm(&r)),
        PoseForm::Matrices => {
            let matrix: Matrix3 = std::array::from_fn(|r| std::array::from_fn(|c| x[3 * r + c]));
            Some(logarithm(&nearest_rotation(&matrix)))
        }
    }
}

/// N×K×3 as N clouds of points.
fn clouds(name: &str, tensor: &Tensor) -> Result<Vec<Vec<Vector3>>, String> {
    let [n, k, 3] = tensor.shape[..] else {
        return Err(format!("output \"{name}\" is {:?}, expected [N, points, 3] in metres", tensor.shape));
    };
    let points: Vec<Vector3> = tensor.data.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    Ok((0..n).map(|i| points[i * k..(i + 1) * k].to_vec()).collect())
}

/// N×… as N rows of so many numbers.
fn rows<'a>(name: &str, tensor: &'a Tensor, width: Option<usize>) -> Result<Vec<&'a [f64]>, String> {
    let found: usize = tensor.shape.iter().skip(1).product();
    if tensor.shape.is_empty() || found == 0 || width.is_some_and(|width| width != found) {
        let expected = width.map_or("some".to_owned(), |width| width.to_string());
        return Err(format!(
            "output \"{name}\" is {:?}, expected {expected} numbers for each person",
            tensor.shape
        ));
    }
    Ok(tensor.data.chunks_exact(found).collect())
}

fn distances_mm(a: &[Vector3], b: &[Vector3]) -> Vec<f64> {
    a.iter().zip(b).map(|(&p, &q)| MM * distance(p, q)).collect()
}

/// The place and size of the largest distance.
fn worst(distances: &[f64]) -> Option<(usize, f64)> {
    let places = distances.iter().copied().enumerate();
    places.max_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, d)| d.is_finite())
}

fn joint_name(joint: usize) -> String {
    JOINT_NAMES.get(joint).map_or(joint.to_string(), |name| (*name).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::body::mannequin;
    use vitruvian_reference::rotation::{rodrigues, to_six_d};

    fn points(vertices: &[Vector3], joints: &[Vector3]) -> Vec<Outputs> {
        let tensor = |points: &[Vector3]| {
            Tensor::new(&[1, points.len(), 3], points.iter().flatten().copied().collect())
        };
        vec![Outputs::from([
            ("vertices".to_owned(), tensor(vertices)),
            ("joints".to_owned(), tensor(joints)),
        ])]
    }

    fn report(ruler: &BodyRuler, variant: &[Outputs]) -> (BodyReport, Summary) {
        let Ok((Geometry::Body(report), Some(distances))) = ruler.report(variant) else {
            panic!("a body report")
        };
        (report, distances)
    }

    const JOINTS: [Vector3; 4] = [[0.0, 1.0, 0.0], [0.2, 0.5, 0.1], [-0.2, 0.5, 0.0], [0.0, 1.6, -0.1]];

    #[test]
    fn one_vertex_a_millimetre_off_is_named() {
        let vertices = [[0.0; 3], [0.5, 1.0, 0.0], [0.0, 1.5, 0.2]];
        let mut moved = vertices;
        moved[1][2] += 0.001;
        let ruler = BodyRuler::new(Source::Points { faces: vec![[0, 1, 2]] }, &points(&vertices, &JOINTS))
            .expect("bodies");
        let (found, distances) = report(&ruler, &points(&moved, &JOINTS));
        let worst = found.worst_vertex.expect("a vertex");
        assert_eq!((worst.vertex, worst.body), (1, 0));
        assert!((worst.millimetres - 1.0).abs() < 1e-12 && (distances.max - 1.0).abs() < 1e-12);
        assert!((distances.mean - 1.0 / 3.0).abs() < 1e-12);
        assert!(found.mpjpe < Some(1e-12) && found.joints.expect("finite").max < 1e-12);
        let view = ruler.view(&points(&moved, &JOINTS)).expect("bodies").expect("faces");
        assert_eq!(view.millimetres.len(), 3);
        assert!((view.millimetres[1] - 1.0).abs() < 1e-6 && view.millimetres[0] == 0.0);
    }

    #[test]
    fn a_common_shift_shows_in_the_joints_but_not_relative_to_the_root() {
        let shifted = JOINTS.map(|[x, y, z]| [x + 0.003, y, z + 0.004]);
        let ruler =
            BodyRuler::new(Source::Points { faces: Vec::new() }, &points(&JOINTS, &JOINTS)).expect("bodies");
        let (found, _) = report(&ruler, &points(&shifted, &shifted));
        assert!((found.joints.expect("finite").mean - 5.0).abs() < 1e-9);
        assert!(found.mpjpe < Some(1e-9) && found.pa_mpjpe < Some(1e-9));
    }

    #[test]
    fn bodies_that_are_not_finite_are_refused_in_the_base_and_not_measured_in_the_variant() {
        let mut broken = JOINTS;
        broken[0][0] = f64::NAN;
        assert!(BodyRuler::new(Source::Points { faces: Vec::new() }, &points(&broken, &JOINTS)).is_err());
        let ruler =
            BodyRuler::new(Source::Points { faces: Vec::new() }, &points(&JOINTS, &JOINTS)).expect("bodies");
        assert_eq!(ruler.displacement(&points(&broken, &JOINTS)).expect("shapes").lengths, None);
        assert_eq!(ruler.report(&points(&broken, &JOINTS)).expect("joints").1, None);
    }

    #[test]
    fn another_shape_is_refused_by_name() {
        let ruler =
            BodyRuler::new(Source::Points { faces: Vec::new() }, &points(&JOINTS, &JOINTS)).expect("bodies");
        assert!(ruler.report(&points(&JOINTS[..3], &JOINTS)).is_err());
        let flat = vec![Outputs::from([("vertices".to_owned(), Tensor::new(&[12], vec![0.0; 12]))])];
        assert!(ruler.report(&flat).expect_err("a flat output").contains("output \"vertices\" is [12]"));
    }

    /// A person with every joint turned, as a regressor of each form would write it.
    fn parameters(form: PoseForm, turn: f64, camera: [f64; 3]) -> Vec<Outputs> {
        let numbers = |j: usize| -> Vec<f64> {
            let v = [turn * (j as f64).sin(), 0.3 * (j as f64).cos(), 0.1];
            match form {
                PoseForm::AxisAngle => v.to_vec(),
                PoseForm::SixD => to_six_d(&rodrigues(v)).to_vec(),
                PoseForm::Matrices => rodrigues(v).into_iter().flatten().collect(),
            }
        };
        let pose: Vec<f64> = (0..24).flat_map(numbers).collect();
        vec![Outputs::from([
            ("pose".to_owned(), Tensor::new(&[1, pose.len()], pose)),
            ("betas".to_owned(), Tensor::new(&[1, 10], vec![0.5; 10])),
            ("camera".to_owned(), Tensor::new(&[1, 3], camera.to_vec())),
        ])]
    }

    fn source(form: PoseForm) -> Source {
        let (body, name) = (Box::new(mannequin()), "the mannequin".to_owned());
        Source::Parameters { body, name, form, focal_px: 5000.0, side_px: 224.0 }
    }

    #[test]
    fn every_form_of_the_pose_is_the_same_body() {
        let camera = [0.9, 0.0, 0.1];
        let matrices =
            source(PoseForm::Matrices).figures(&parameters(PoseForm::Matrices, 0.2, camera)).expect("a body");
        for form in [PoseForm::SixD, PoseForm::AxisAngle] {
            let other = source(form).figures(&parameters(form, 0.2, camera)).expect("a body");
            let apart = distances_mm(&matrices[0].vertices, &other[0].vertices);
            assert!(apart.iter().all(|&mm| mm < 1e-9), "{form:?}");
        }
    }

    #[test]
    fn a_camera_head_in_f16_moves_the_camera_by_millimetres_and_the_body_not_at_all() {
        let form = PoseForm::SixD;
        let ruler = BodyRuler::new(source(form), &parameters(form, 0.2, [0.9, 0.0, 0.1])).expect("a body");
        let half = |x: f64| f64::from(half::f16::from_f64(x));
        let (found, distances) = report(&ruler, &parameters(form, 0.2, [half(0.9), 0.0, half(0.1)]));
        assert!(distances.max < 1e-12);
        // t_z = 2·5000/(224·s): 49.6 m at s = 0.9, and δt_z = t_z·δs/s.
        let expected = 1000.0 * 49.603_17 * (half(0.9) - 0.9).abs() / 0.9;
        let camera = found.camera.expect("a camera").max;
        assert!((camera / expected - 1.0).abs() < 0.01, "{camera} mm, {expected} mm");
        assert!(found.reprojection_px.expect("a camera").max > 0.0);
    }

    #[test]
    fn a_pose_that_is_no_rotation_makes_a_body_that_is_not_finite() {
        let mut broken = parameters(PoseForm::SixD, 0.2, [0.9, 0.0, 0.0]);
        let pose = broken[0].get_mut("pose").expect("a pose");
        pose.data[..6].fill(0.0);
        let ruler = BodyRuler::new(source(PoseForm::SixD), &parameters(PoseForm::SixD, 0.2, [0.9, 0.0, 0.0]))
            .expect("a body");
        assert_eq!(ruler.displacement(&broken).expect("shapes").lengths, None);
        let (Geometry::Body(found), None) = ruler.report(&broken).expect("shapes") else {
            panic!("no distances")
        };
        assert_eq!((found.mpjpe, found.joints, found.worst_joint), (None, None, None));
        assert_eq!(ruler.view(&broken), Ok(None));
    }
}
