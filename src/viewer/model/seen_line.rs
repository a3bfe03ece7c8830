//! Lines of the world as they are seen in a picture.

use glam::{DVec2, DVec3};

use crate::camera::Camera;

/// Parts of a segment that is seen as a curve.
pub const CURVE_PARTS: u32 = 12;

/// The pieces of a segment of the world in a picture, in pixels: the part in front of a pinhole; through a lens, the
/// pieces of a curve.
pub fn line_pieces(view: &Camera, [a, b]: [DVec3; 2]) -> Vec<[DVec2; 2]> {
    if view.lens.is_some() {
        return curve_pieces(view, (0..=CURVE_PARTS).map(|i| a.lerp(b, f64::from(i) / f64::from(CURVE_PARTS))));
    }
    let seen = before_camera(view, [a, b]).map(|ends| ends.map(|end| view.projected(end)));
    match seen {
        Some([Some((a, _)), Some((b, _))]) => vec![[a, b]],
        _ => Vec::new(),
    }
}

/// The pieces between neighbours of some points of the world in a picture, in pixels, without those that leave the
/// picture on one side and come back on the other.
pub fn curve_pieces(view: &Camera, places: impl Iterator<Item = DVec3>) -> Vec<[DVec2; 2]> {
    let seen: Vec<Option<DVec2>> = places.map(|place| Some(view.projected(place)?.0)).collect();
    let farthest = f64::from(view.size_px[0]) / 2.0;
    let pieces = seen.windows(2).filter_map(|pair| Some([pair[0]?, pair[1]?]));
    pieces.filter(|[a, b]| a.distance(*b) < farthest).collect()
}

/// The part of a segment in front of a pinhole; all of it through a lens.
pub fn before_camera(view: &Camera, [a, b]: [DVec3; 2]) -> Option<[DVec3; 2]> {
    if view.lens.is_some() {
        return Some([a, b]);
    }
    let near = 1e-3 * (a - b).length();
    let [a_z, b_z] = [a, b].map(|place| view.view(place).z);
    let cut = |p: DVec3, z: f64, q: DVec3, other_z: f64| {
        if z >= near { p } else { p + (q - p) * ((near - z) / (other_z - z)) }
    };
    (a_z > near || b_z > near).then(|| [cut(a, a_z, b, b_z), cut(b, b_z, a, a_z)])
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::camera::Lens;

    #[test]
    fn a_segment_is_cut_at_a_pinhole_and_bent_by_a_lens() {
        let pinhole = Camera::looking_at(DVec3::ZERO, DVec3::Z, [200, 100], 1.0);
        let segment = [DVec3::new(-1.0, 1.0, 2.0), DVec3::new(1.0, 1.0, 2.0)];
        let [[a, b]] = line_pieces(&pinhole, segment)[..] else { panic!("one piece") };
        assert!((a.y - b.y).abs() < 1e-9 && a.x < b.x, "{a} {b}");
        let [[a, b]] = line_pieces(&pinhole, [segment[0], DVec3::new(0.0, 0.0, -3.0)])[..] else { panic!("a part") };
        assert!(a.is_finite() && b.is_finite(), "{a} {b}");
        assert!(line_pieces(&pinhole, segment.map(|end| -end)).is_empty(), "all of it is behind the camera");
        let fisheye = Lens::named("FISHEYE", &[]).unwrap().map(Arc::new);
        let curve = line_pieces(&Camera { lens: fisheye, ..pinhole.clone() }, segment);
        assert_eq!(curve.len(), CURVE_PARTS as usize);
        let middle = curve[CURVE_PARTS as usize / 2][0];
        assert!((middle.y - curve[0][0].y).abs() > 1.0, "{curve:?}");
        // A segment through the seam of a panorama is not drawn across it.
        let panorama = Lens::named("EQUIRECTANGULAR", &[]).unwrap().map(Arc::new);
        let behind = [DVec3::new(-1.0, 0.3, -2.0), DVec3::new(1.0, 0.3, -2.0)];
        let whole = Camera { lens: panorama, ..pinhole };
        let pieces = line_pieces(&whole, behind);
        assert!(pieces.len() == CURVE_PARTS as usize || pieces.len() + 1 == CURVE_PARTS as usize, "{pieces:?}");
        assert!(pieces.iter().all(|[a, b]| a.distance(*b) < 100.0), "{pieces:?}");
    }
}
