//! Actions that measure with points, and place a scene by them.

use glam::{DMat3, DQuat, DVec3};

use crate::scene::Transform;
use crate::viewer::model::{LengthUnit, Measure, MeasureKind, Placement, Request, Viewer, WindowRequest, aligning};

impl Viewer {
    /// Adds the point at a pixel to the open measure, and copies its position; `depth` is its view z in world units.
    pub fn mark(&mut self, pixel: [u32; 2], depth: Option<f32>) {
        let Some(depth) = depth else { return self.messages.note("there is nothing at this pixel") };
        let point = self.point_at(pixel, depth.into());
        self.record_undo_step();
        self.measure(point);
        let position = format!("{:.6}, {:.6}, {:.6}", point.x, point.y, point.z);
        let measure = self.ruler.open.map(|index| &self.measures.all[index]);
        let reading = measure.map_or_else(String::new, |measure| self.measures.reading(measure));
        // The clipboard of a user elsewhere is not that of this machine.
        let is_copied = !self.panels.are_elsewhere;
        let text = format!("{}: {position}", if is_copied { "marked and copied" } else { "marked" });
        self.messages.note(if reading.is_empty() { text } else { format!("{text}; {reading}") });
        if is_copied {
            self.requests.push(Request::Window(WindowRequest::Copy(position)));
        }
    }

    /// Adds a point to the open measure.
    pub fn measure(&mut self, point: DVec3) {
        self.ruler.open = Some(self.measures.add(self.ruler.open, self.ruler.kind, point));
    }

    /// Removes a measure.
    pub fn remove_measure(&mut self, index: usize) {
        self.measures.all.remove(index);
        self.ruler.open = None;
    }

    /// Sets the unit by the last line of the open measure, whose length is known.
    ///
    /// # Errors
    /// There is no such line.
    pub fn set_unit(&mut self) -> Result<(), &'static str> {
        let line = self.open_measure().and_then(|measure| measure.lines().last().copied());
        let world = line.map_or(0.0, |[a, b]| a.distance(b));
        let per_world = self.ruler.known / world;
        if !(per_world.is_finite() && per_world > 0.0) {
            return Err("mark two points whose distance is known first");
        }
        let unit = LengthUnit { name: self.ruler.unit.trim().to_owned(), per_world };
        self.measures.unit = Some(unit);
        Ok(())
    }

    /// The measure that gets the next point.
    pub fn open_measure(&self) -> Option<&Measure> {
        self.measures.all.get(self.ruler.open?)
    }

    /// Rotates the placed layer until the last three points of the open measure are level. If it also `orients`, the
    /// first of them comes to the origin, and the second to the axis x.
    pub fn level_by_points(&mut self, orients: bool) {
        let points: Vec<DVec3> = self.open_measure().map(|one| one.points().collect()).unwrap_or_default();
        let [.., a, b, c] = points[..] else {
            return self.messages.note("mark three points of the ground first");
        };
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            return self.messages.note("the three points lie on a line: they say nothing of the ground");
        };
        let up = self.view.navigator.up().vector();
        // The ground is seen from above.
        let normal = if normal.dot(self.view.camera().position - a) < 0.0 { -normal } else { normal };
        let mut turn = DQuat::from_rotation_arc(normal, up);
        let mut to = a;
        if orients {
            let along = (turn * (b - a)).normalize();
            let axis = if up.x == 0.0 { DVec3::X } else { DVec3::Y };
            // Both are level, so this turns around the up axis.
            let [from, onto] = [along, axis].map(|x| DMat3::from_cols(x, up, x.cross(up)));
            turn = DQuat::from_mat3(&(onto * from.transpose())) * turn;
            to = DVec3::ZERO;
        }
        let moves = Transform::new(turn, to - turn * a, 1.0);
        let degrees = normal.angle_between(up).to_degrees();
        if let Some(name) = moves.ok().and_then(|moves| self.place_by(&moves, |_| true)) {
            self.messages.note(format!("{name} is turned by {degrees:.2} degrees to be level"));
        }
    }

    /// Moves the placed layer so that the first points of the pairs of the open measure come to the second ones, with
    /// the least squares of distances.
    pub fn align_by_pairs(&mut self) {
        let Some(measure) = self.open_measure().filter(|measure| measure.kind == MeasureKind::Pairs) else { return };
        let Some(moves) = aligning(&measure.lines(), self.ruler.scales) else {
            let text = "three pairs of points, which do not lie on a line, place a scene: mark a point of the scene, \
                        then where it belongs";
            return self.messages.note(text);
        };
        let Some(name) = self.place_by(&moves, |point| point % 2 == 0) else { return };
        let left = self.open_measure().and_then(Measure::root_mean_square).unwrap_or(0.0);
        let left = self.measures.length(left);
        self.messages.note(format!("{name} is aligned: its points are {left} off, root mean square"));
    }

    /// Places the layer of the handles by a movement of the world, which those points of the open measure that move
    /// with it follow. Returns the name of the layer.
    fn place_by(&mut self, moves: &Transform, follows: impl Fn(usize) -> bool) -> Option<String> {
        let number = self.placed_layer()?;
        let layer = self.scenes.layer_mut(number)?;
        match layer.placement.transform().and_then(|before| before.then(moves)) {
            Ok(placed) => layer.placement = Placement::of(&placed),
            Err(problem) => {
                self.messages.error(format!("{problem:#}"));
                return None;
            }
        }
        let name = layer.name.clone();
        if let Some(measure) = self.ruler.open.and_then(|index| self.measures.all.get_mut(index)) {
            let points = measure.points.iter_mut().enumerate().filter(|(i, _)| follows(*i));
            points.for_each(|(_, point)| *point = moves.point(DVec3::from(*point)).to_array());
        }
        self.pictures.are_stale = true;
        Some(name)
    }
}
