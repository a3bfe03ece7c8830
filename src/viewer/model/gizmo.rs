//! The gizmo: handles that place a scene, their positions in the picture, and the effect of dragging them.

use std::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3, EulerRot};

use super::drag::Handle;
use super::layers::Placement;
use crate::camera::Camera;
use crate::render::from_segment;

/// Length of an arrow, as a fraction of the shorter side of the picture.
const LENGTH: f64 = 0.16;
/// Radius of a ring, as a fraction of the length of an arrow.
const RING: f64 = 0.75;
/// Corners of a ring.
const CORNERS: usize = 48;
/// Distance within which a handle is grabbed, in points.
const GRIP: f64 = 7.0;
/// Sine of the least angle between a ray and the plane of a ring, for a drag of the ring.
const EDGE: f64 = 0.02;
/// Pixels of a drag by which the scale grows by a factor of e.
const SCALE_PX: f64 = 200.0;

/// Handles around a point in world space.
pub struct Gizmo {
    view: Camera,
    pub centre: DVec3,
    /// Length of an arrow, world units.
    length: f64,
}

impl Gizmo {
    /// The handles around a point; `None` if the point is not in front of the camera, or the rays are parallel.
    pub fn new(view: &Camera, centre: DVec3) -> Option<Self> {
        if view.is_parallel() {
            return None;
        }
        let depth = view.view(centre).z;
        let side = f64::from(view.size_px[0].min(view.size_px[1]));
        let length = LENGTH * side * depth / view.focal_px.x;
        (depth > 0.0 && length.is_finite()).then(|| Self { view: view.clone(), centre, length })
    }

    /// The end of an arrow.
    pub fn end(&self, axis: usize) -> DVec3 {
        self.centre + DVec3::AXES[axis] * self.length
    }

    /// The corners of a ring around an axis, closed: the last equals the first.
    pub fn ring(&self, axis: usize) -> Vec<DVec3> {
        let [a, b] = [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
        let corner = |i: usize| {
            let angle = TAU * i as f64 / CORNERS as f64;
            self.centre + (a * angle.cos() + b * angle.sin()) * self.length * RING
        };
        (0..=CORNERS).map(corner).collect()
    }

    /// The handle at a position in the picture, in pixels; `points` is the number of pixels per point.
    pub fn at(&self, place: DVec2, points: f64) -> Option<Handle> {
        let grip = GRIP * points;
        if self.projected(self.centre)?.distance(place) <= grip {
            return Some(Handle::Scale);
        }
        let apart = |ends: &[DVec3]| {
            let places: Vec<DVec2> = ends.iter().filter_map(|end| self.projected(*end)).collect();
            places.windows(2).map(|ends| from_segment(place, [ends[0], ends[1]])).fold(f64::INFINITY, f64::min)
        };
        let moves = (0..3).map(|axis| (Handle::Move(axis), apart(&[self.centre, self.end(axis)])));
        let turns = (0..3).map(|axis| (Handle::Turn(axis), apart(&self.ring(axis))));
        let nearest = moves.chain(turns).min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 <= grip).then_some(nearest.0)
    }

    /// The placement after a handle was dragged from one position in the picture to another, in pixels. `None` if the
    /// positions do not determine it.
    pub fn dragged(&self, place: Placement, handle: Handle, from: DVec2, to: DVec2) -> Option<Placement> {
        match handle {
            Handle::Move(axis) => {
                let arrow = self.projected(self.end(axis))? - self.projected(self.centre)?;
                // An arrow that points at the camera cannot be dragged.
                let along = (to - from).dot(arrow) / arrow.length_squared().max(1.0);
                let translation = (DVec3::from(place.translation) + DVec3::AXES[axis] * along * self.length).to_array();
                Some(Placement { translation, ..place })
            }
            Handle::Turn(axis) => {
                let [a, b] = [self.on_plane(axis, from)?, self.on_plane(axis, to)?];
                let angle = a.cross(b).dot(DVec3::AXES[axis]).atan2(a.dot(b));
                Some(turned(place, self.centre, DQuat::from_axis_angle(DVec3::AXES[axis], angle)))
            }
            Handle::Scale => {
                let factor = ((to - from).dot(DVec2::new(1.0, -1.0)) / SCALE_PX).exp();
                let offset = (DVec3::from(place.translation) - self.centre) * factor;
                Some(Placement { scale: place.scale * factor, translation: (self.centre + offset).to_array(), ..place })
            }
        }
    }

    /// The point on the plane of a ring at a position in the picture, relative to the centre. `None` if the plane is
    /// seen edge-on, or lies behind the camera.
    fn on_plane(&self, axis: usize, place: DVec2) -> Option<DVec3> {
        let (axis, eye) = (DVec3::AXES[axis], self.view.position);
        let ray = (self.view.unprojected(place, 1.0) - eye).normalize();
        let steep = ray.dot(axis);
        let along = (self.centre - eye).dot(axis) / steep;
        (steep.abs() > EDGE && along > 0.0).then(|| eye + ray * along - self.centre)
    }

    /// The position of a point in the picture, in pixels.
    fn projected(&self, point: DVec3) -> Option<DVec2> {
        self.view.projected(point).map(|(place, _)| place)
    }
}

/// Handles on the faces of a box of the world.
pub struct BoxHandles {
    view: Camera,
    corners: [DVec3; 2],
}

impl BoxHandles {
    /// The handles of a box with this least and this greatest corner.
    pub fn new(view: &Camera, corners: [DVec3; 2]) -> Self {
        Self { view: view.clone(), corners }
    }

    /// The centre of a face: its axis, and true for the greater coordinate.
    pub fn face(&self, axis: usize, is_greater: bool) -> DVec3 {
        let mut centre = (self.corners[0] + self.corners[1]) / 2.0;
        centre[axis] = self.corners[usize::from(is_greater)][axis];
        centre
    }

    /// The ends of the twelve edges.
    pub fn edges(&self) -> impl Iterator<Item = [DVec3; 2]> {
        let corner = |bits: usize| DVec3::from_array(std::array::from_fn(|axis| self.corners[bits >> axis & 1][axis]));
        (0..8).flat_map(move |from: usize| {
            let ends = (0..3).map(move |axis| from | 1 << axis).filter(move |to| *to != from);
            ends.map(move |to| [corner(from), corner(to)])
        })
    }

    /// The face whose handle is at a position in the picture, in pixels; `points` is the number of pixels per point.
    pub fn at(&self, place: DVec2, points: f64) -> Option<(usize, bool)> {
        let faces = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
        let apart = |(axis, is_greater): &(usize, bool)| {
            let (centre, _) = self.view.projected(self.face(*axis, *is_greater))?;
            Some(centre.distance(place))
        };
        let near = faces.filter_map(|face| Some((face, apart(&face)?)));
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 <= GRIP * points).then_some(nearest.0)
    }

    /// The corners after a face was dragged from one position in the picture to another, in pixels. A face stops at
    /// the opposite one.
    pub fn dragged(&self, (axis, is_greater): (usize, bool), from: DVec2, to: DVec2) -> [DVec3; 2] {
        let mut corners = self.corners;
        let centre = self.face(axis, is_greater);
        let Some((place, depth)) = self.view.projected(centre) else { return corners };
        let length = LENGTH * f64::from(self.view.size_px[0].min(self.view.size_px[1])) * self.view.pixel_world(depth);
        let Some((end, _)) = self.view.projected(centre + DVec3::AXES[axis] * length) else { return corners };
        // An axis that points at the camera cannot be dragged along.
        let along = (to - from).dot(end - place) / (end - place).length_squared().max(1.0);
        let moved = centre[axis] + along * length;
        corners[usize::from(is_greater)][axis] = match is_greater {
            true => moved.max(corners[0][axis]),
            false => moved.min(corners[1][axis]),
        };
        corners
    }
}

/// The placement turned about the point `centre` by a rotation of the world.
pub fn turned(place: Placement, centre: DVec3, turn: DQuat) -> Placement {
    let [y, x, z] = [1, 0, 2].map(|i| place.rotation[i].to_radians());
    let (y, x, z) = (turn * DQuat::from_euler(EulerRot::YXZ, y, x, z)).to_euler(EulerRot::YXZ);
    let offset = DVec3::from(place.translation) - centre;
    Placement { rotation: [x, y, z].map(f64::to_degrees), translation: (centre + turn * offset).to_array(), ..place }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gizmo() -> Gizmo {
        let centre = DVec3::new(0.5, -0.2, 0.3);
        let view = Camera::looking_at(centre + DVec3::new(2.0, -1.5, -4.0), centre, [400, 300], 1.0);
        Gizmo::new(&view, centre).unwrap()
    }

    /// A point of the scene follows the pointer.
    fn follows(handle: Handle, point: DVec3, by: DVec2) {
        let gizmo = gizmo();
        let place = Placement { translation: [0.1, 0.2, 0.3], rotation: [10.0, 20.0, 30.0], scale: 1.5 };
        let before = place.transform().unwrap();
        let local = before.inverse().unwrap().point(point);
        let from = gizmo.projected(point).unwrap();
        assert_eq!(gizmo.at(from, 1.0), Some(handle));
        let after = gizmo.dragged(place, handle, from, from + by).unwrap();
        let moved = gizmo.projected(after.transform().unwrap().point(local)).unwrap();
        let due = from + by;
        assert!(moved.distance(due) < 0.15 * by.length(), "{handle:?}: {moved} instead of {due}");
    }

    #[test]
    fn what_is_dragged_follows_the_pointer() {
        let gizmo = gizmo();
        let centre = gizmo.projected(gizmo.centre).unwrap();
        for axis in 0..3 {
            let arrow = gizmo.projected(gizmo.end(axis)).unwrap() - centre;
            follows(Handle::Move(axis), gizmo.end(axis), arrow.normalize() * 5.0);
            // Along the ring, by the next of its corners.
            let ring = gizmo.ring(axis);
            let step = gizmo.projected(ring[6]).unwrap() - gizmo.projected(ring[5]).unwrap();
            follows(Handle::Turn(axis), ring[5], step);
        }
        assert_eq!(gizmo.at(centre, 1.0), Some(Handle::Scale));
        // A ring seen edge-on determines no angle.
        let level = Camera::looking_at(gizmo.centre - DVec3::Z * 5.0, gizmo.centre, [400, 300], 1.0);
        let edge = Gizmo::new(&level, gizmo.centre).unwrap();
        let middle = edge.projected(edge.centre).unwrap();
        let [from, to] = [20.0, 30.0].map(|x| middle + DVec2::new(x, 0.0));
        assert_eq!(edge.dragged(Placement::default(), Handle::Turn(1), from, to), None);
        assert_eq!(gizmo.at(centre + 190.0, 1.0), None);
        let place = Placement { translation: gizmo.centre.to_array(), ..Placement::default() };
        let larger = gizmo.dragged(place, Handle::Scale, centre, centre + DVec2::new(SCALE_PX, 0.0)).unwrap();
        assert!((larger.scale - 1f64.exp()).abs() < 1e-9 && larger.translation == place.translation);
        assert!(Gizmo::new(&gizmo.view, gizmo.view.position - gizmo.view.forward()).is_none());
    }

    #[test]
    fn faces_of_a_box_follow_the_pointer() {
        let corners = [DVec3::new(0.0, -0.5, 0.1), DVec3::new(1.0, 0.3, 0.6)];
        let view = Camera::looking_at(DVec3::new(3.0, -2.0, -4.0), DVec3::new(0.5, 0.0, 0.3), [400, 300], 1.0);
        let handles = BoxHandles::new(&view, corners);
        assert_eq!(handles.edges().count(), 12);
        for (axis, is_greater) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
            let (from, _) = view.projected(handles.face(axis, is_greater)).unwrap();
            assert_eq!(handles.at(from, 1.0), Some((axis, is_greater)));
            let (to, _) = view.projected(handles.face(axis, is_greater) + DVec3::AXES[axis] * 0.1).unwrap();
            let moved = handles.dragged((axis, is_greater), from, to);
            let by = moved[usize::from(is_greater)][axis] - corners[usize::from(is_greater)][axis];
            assert!((by - 0.1).abs() < 0.01, "axis {axis}: {by}");
            // A face does not pass the opposite one.
            let far =
                handles.dragged((axis, !is_greater), from, from + (to - from) * if is_greater { 99.0 } else { -99.0 });
            assert_eq!(far[0][axis], far[1][axis]);
        }
    }
}
