//! Fits groups of nodes. Groups that wait at the same time are fitted together, so that the device has work for all of
//! its processors.

use std::collections::{BTreeMap, VecDeque};
use std::iter::once;
use std::mem::{forget, replace, take};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Error, Result, anyhow, ensure};

use super::workspace::{Drawn, Part, Plan, Workspace, tiles_of};
use crate::gpu::{Access, Commands, Device, DispatchSize, Feature, InFlight, Results, Stage};
use crate::lod::{
    CLAMPED, COLOUR_ROUNDS, FitOptions, Fitter, Group, LEAST, LEAST_ALPHA, LEAST_COVERED, LEAST_GRADIENT, MOST_CHANGE,
    MOST_DEVIATIONS, MOST_FACTOR, Measured, Node, Nodes, PER_ALPHA_MIN, REPLACED, VIEWS, simplify, total,
};
use crate::render::shaders::fit::*;
use crate::render::shaders::{FitNode, FitTile};
use crate::rules::{ALPHA_MAX, ALPHA_MIN};

// Numbers that the host and the shaders both have.
const _: () = assert!(FIT_ALPHA_MIN == ALPHA_MIN && FIT_PER_ALPHA_MIN == PER_ALPHA_MIN);
const _: () = assert!(FIT_MOST_DEVIATIONS as f64 == MOST_DEVIATIONS && FIT_LEAST == LEAST);

/// Most groups in one submission. Most take some 0.1 GB of device memory.
const MOST_GROUPS: usize = 16;
/// Most rounds of shapes in one submission: a slow device must not keep a desktop waiting for long.
const MOST_ROUNDS: usize = 4;

/// Fits nodes on a device, with the bits of the host.
pub struct DeviceFitter {
    device: Device,
    stages: Stages,
    idle: Mutex<Idle>,
    freed: Condvar,
    queue: Mutex<Queue>,
    /// Why groups were left to the host, by the first of them.
    failure: Mutex<Option<Error>>,
    /// GPU times of stages.
    times_ms: Mutex<BTreeMap<&'static str, f64>>,
}

#[derive(Default)]
struct Idle {
    workspaces: Vec<Workspace>,
    /// Workspaces that were made, idle or not.
    made: usize,
}

/// Groups that wait.
#[derive(Default)]
struct Queue {
    waiting: Vec<Waiting>,
    /// A thread submits groups.
    is_led: bool,
}

/// A group that waits, and the upload of its nodes.
struct Waiting {
    workspace: Workspace,
    plan: Plan,
    upload: InFlight,
    messages: SyncSender<Message>,
}

/// What the thread of a waiting group learns.
enum Message {
    /// This thread submits all groups that wait.
    Lead,
    Finished(Box<Finished>),
}

/// The right to submit groups. Dropped, it goes to the thread of a group that waits.
struct Turn<'f>(&'f Mutex<Queue>);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut queue = locked(self.0);
        // The thread of a group in the queue waits for messages.
        queue.is_led = queue.waiting.first().is_some_and(|first| first.messages.send(Message::Lead).is_ok());
    }
}

impl Waiting {
    fn drawn(&self, picture: Picture) -> &Drawn {
        match picture {
            Picture::Children => &self.workspace.children,
            _ => &self.workspace.parents,
        }
    }
}

/// The workspace of a group and what was found, or none if it did not fit into the workspace.
type Finished = (Workspace, Result<Option<Found>>);

/// Fitted nodes, and what [`Measured`] sums up.
struct Found {
    nodes: Vec<FitNode>,
    parts: Vec<f32>,
    tiles: Vec<FitTile>,
    /// The tiles of a window that there is room for.
    most_tiles: usize,
}

impl Found {
    fn measured(&self, group: &Group) -> Measured {
        let sums = |tile: &FitTile| tile.sums.map(|[low, high]| f64::from_bits(u64::from(high) << 32 | u64::from(low)));
        let windows = group.windows.iter().zip(self.tiles.chunks(self.most_tiles.max(1)));
        let windows = windows.map(|(window, tiles)| total(tiles[..tiles_of(window)].iter().map(sums)));
        Measured::of(windows, &self.parts[..VIEWS * group.is_new.len()], group.is_new)
    }
}

/// A workspace that is not idle. If it is lost, another one may be made.
struct Lent<'f>(&'f DeviceFitter);

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        locked(&self.0.idle).made -= 1;
        self.0.freed.notify_one();
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl DeviceFitter {
    /// Builds the pipelines, and fits some nodes on the device and on the host.
    ///
    /// # Errors
    /// If the device has no 64-bit floats or other bits than the host, or memory runs out.
    pub fn new(device: &Device) -> Result<Self> {
        let capabilities = device.capabilities();
        ensure!(capabilities.has(Feature::DoubleFloats), "{} has no 64-bit floats", capabilities.name);
        let fitter = Self {
            device: device.clone(),
            stages: Stages::new(device)?,
            idle: Mutex::default(),
            freed: Condvar::new(),
            queue: Mutex::default(),
            failure: Mutex::default(),
            times_ms: Mutex::default(),
        };
        let [found, expected] = [Some(&fitter as &dyn Fitter), None]
            .map(|fitter| simplify(&sample(), SAMPLE / 2, 0.0, FitOptions { shape_rounds: 2, fitter }));
        if let Some(failure) = fitter.take_failure() {
            return Err(failure);
        }
        ensure!(found == expected, "{} makes other bits than the host", capabilities.name);
        Ok(fitter)
    }

    /// Why a group was left to the host, if one was since the last call.
    pub fn take_failure(&self) -> Option<Error> {
        locked(&self.failure).take()
    }

    /// The GPU time of each stage since the last call, milliseconds: the sum of its dispatches.
    pub fn take_times_ms(&self) -> BTreeMap<&'static str, f64> {
        take(&mut locked(&self.times_ms))
    }

    fn take_workspace(&self) -> Result<(Workspace, Lent<'_>)> {
        let mut idle = locked(&self.idle);
        loop {
            if let Some(workspace) = idle.workspaces.pop() {
                return Ok((workspace, Lent(self)));
            }
            if idle.made < MOST_GROUPS {
                match Workspace::new(&self.device) {
                    Ok(workspace) => {
                        idle.made += 1;
                        return Ok((workspace, Lent(self)));
                    }
                    Err(error) if idle.made == 0 => return Err(error),
                    Err(_) => {}
                }
            }
            idle = self.freed.wait(idle).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn give_back(&self, workspace: Workspace, lent: Lent) {
        if !workspace.is_large() {
            forget(lent);
            locked(&self.idle).workspaces.push(workspace);
            self.freed.notify_one();
        }
    }

    /// Fits the parents, and measures them. Lists that are too small grow.
    fn try_fit(&self, group: &Group, parents: &mut Nodes) -> Result<Measured> {
        let (mut workspace, lent) = self.take_workspace()?;
        loop {
            let found = match workspace.load(&self.device, group, parents) {
                Ok((plan, upload)) => {
                    let finished = self.run(workspace, plan, upload);
                    let (used, found) = finished.context("the thread that submits groups has panicked")?;
                    workspace = used;
                    found
                }
                Err(error) => Err(error),
            };
            let done = match found {
                Ok(Some(found)) => {
                    for (i, node) in found.nodes.iter().take(parents.len()).enumerate() {
                        let FitNode { mean, rotation, scale, opacity, size, colour, .. } = *node;
                        parents.nodes[i] = Node { mean, rotation, scale, opacity, size, ..parents.nodes[i] };
                        parents.sh_mut(i)[0] = colour;
                    }
                    Ok(found.measured(group))
                }
                Ok(None) => match workspace.grow(&self.device) {
                    Ok(()) => continue,
                    Err(error) => Err(error),
                },
                Err(error) => Err(error),
            };
            self.give_back(workspace, lent);
            return done;
        }
    }

    /// Runs a group together with those that wait. `None` if the thread that submitted it has panicked.
    fn run(&self, workspace: Workspace, plan: Plan, upload: InFlight) -> Option<Finished> {
        // A group is told to lead once at most, and then what was found.
        let (messages, received) = sync_channel(2);
        let mut queue = locked(&self.queue);
        queue.waiting.push(Waiting { workspace, plan, upload, messages });
        let is_led = replace(&mut queue.is_led, true);
        let mut turn = (!is_led).then(|| Turn(&self.queue));
        drop(queue);
        loop {
            if let Some(_turn) = turn.take() {
                let groups = take(&mut locked(&self.queue).waiting);
                self.run_together(groups);
            }
            match received.recv().ok()? {
                Message::Lead => turn = Some(Turn(&self.queue)),
                Message::Finished(finished) => return Some(*finished),
            }
        }
    }

    fn run_together(&self, groups: Vec<Waiting>) {
        let mut found: VecDeque<Result<_>> = match self.submit(&groups) {
            Ok(found) => found.into_iter().map(Ok).collect(),
            Err(error) => {
                let copies: Vec<_> = (1..groups.len()).map(|_| Err(anyhow!("{error:#}"))).collect();
                once(Err(error)).chain(copies).collect()
            }
        };
        for Waiting { workspace, upload, messages, .. } in groups {
            // This waits if the submission has failed.
            drop(upload);
            let found = found.pop_front().expect("each group has a result");
            // Fails only if the thread of the group has panicked.
            _ = messages.send(Message::Finished(Box::new((workspace, found))));
        }
    }

    /// What is found for each group, or none if it did not fit into its workspace. Waits for the device.
    fn submit(&self, groups: &[Waiting]) -> Result<Vec<Option<Found>>> {
        let mut cmd = Commands::new(&self.device)?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        self.stages.record_children(&mut cmd, groups);
        (0..COLOUR_ROUNDS).for_each(|round| self.stages.record_correction(&mut cmd, groups, round));
        let (mut earlier, rounds) = (Vec::new(), groups.iter().map(|group| group.plan.shapes.len()).max().unwrap_or(0));
        for first in (0..rounds).step_by(MOST_ROUNDS) {
            let end = rounds.min(first + MOST_ROUNDS);
            (first..end).for_each(|round| self.stages.record_shapes(&mut cmd, groups, round));
            if end < rounds {
                earlier.push(replace(&mut cmd, Commands::new(&self.device)?).submit()?);
            }
        }
        self.stages.record_measurement(&mut cmd, groups);
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let mut read = Vec::new();
        for Waiting { workspace, .. } in groups {
            let Workspace { children, parents, sums, tiles, .. } = workspace;
            let used = [cmd.read(&children.used)?, cmd.read(&parents.used)?];
            read.push((used, cmd.read(&parents.nodes)?, cmd.read(sums)?, cmd.read(tiles)?));
        }
        let results = cmd.submit()?.wait()?;
        let earlier = earlier.into_iter().map(InFlight::wait).collect::<Result<Vec<_>>>()?;
        let mut times_ms = locked(&self.times_ms);
        for timing in earlier.iter().chain([&results]).flat_map(Results::timings) {
            *times_ms.entry(timing.name).or_default() += timing.duration_ms;
        }
        drop(times_ms);
        let found = read.iter().zip(groups).map(|((used, nodes, parts, tiles), Waiting { plan, .. })| {
            let has_all = used.iter().all(|used| results.view(used)[0].is_full == 0);
            has_all.then(|| Found {
                nodes: results.view(nodes).to_vec(),
                parts: results.view(parts).to_vec(),
                tiles: results.view(tiles).to_vec(),
                most_tiles: plan.measured.tiles as usize,
            })
        });
        Ok(found.collect())
    }
}

/// Nodes that a new fitter tries.
const SAMPLE: usize = 256;

fn sample() -> Nodes {
    let mut state = 1_u32;
    // From 0 to 1, by a linear congruential generator (Knuth).
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut nodes = Nodes::new(1);
    for _ in 0..SAMPLE {
        let (mean, rotation) = ([0; 3].map(|_| next()), [0; 4].map(|_| next() - 0.5));
        let scale = [0; 3].map(|_| 0.01 + 0.1 * next());
        nodes.push(Node::leaf(mean, rotation, scale, next()), &[0; 4].map(|_| [0; 3].map(|_| next() - 0.5)));
    }
    nodes
}

impl Fitter for DeviceFitter {
    fn fit(&self, group: &Group, parents: &mut Nodes) -> Option<Measured> {
        let measured = self.try_fit(group, parents);
        measured.map_err(|error| _ = locked(&self.failure).get_or_insert(error)).ok()
    }
}

/// The stages of all rounds.
struct Stages {
    /// One for children, and one for parents, which keeps weights.
    project: [Stage<Project>; 2],
    rank: Stage<Rank>,
    /// By [`Picture`].
    blend: [Stage<Blend>; 3],
    /// For the fit of opacities and colours, and for errors.
    compare: [Stage<Compare>; 2],
    sum: [Stage<Sum>; 2],
    correct: Stage<Correct>,
    gradient: Stage<Gradient>,
    step: Stage<Step>,
}

/// What is drawn.
#[derive(Clone, Copy, PartialEq)]
enum Picture {
    Children,
    /// The parents, with their weights.
    Parents,
    /// The parents, with their weights and slopes.
    Slopes,
}

/// A group, and the views of a dispatch.
type GroupPart<'g> = (&'g Waiting, Part);

/// Invocations of a workgroup.
const WORKGROUP: u32 = 256;
const _: () = assert!(FIT_TILE * FIT_TILE == WORKGROUP);

impl Stages {
    fn new(device: &Device) -> Result<Self> {
        let project = |keeps_weights| Stage::new(device, &ProjectConstants { keeps_weights });
        let blend = |picture| {
            let (keeps_weights, walks_back) = (picture != Picture::Children, picture == Picture::Slopes);
            Stage::new(device, &BlendConstants { keeps_weights, walks_back })
        };
        let compare = |measures| Stage::new(device, &CompareConstants { measures });
        let sum = |values| Stage::new(device, &SumConstants { values });
        Ok(Self {
            project: [project(false)?, project(true)?],
            rank: Stage::new(device, &())?,
            blend: [blend(Picture::Children)?, blend(Picture::Parents)?, blend(Picture::Slopes)?],
            compare: [compare(false)?, compare(true)?],
            sum: [sum(FIT_RESIDUALS)?, sum(1)?],
            correct: Stage::new(device, &())?,
            gradient: Stage::new(device, &())?,
            step: Stage::new(device, &())?,
        })
    }

    fn record_children(&self, cmd: &mut Commands, groups: &[Waiting]) {
        let parts: Vec<_> = groups.iter().map(|group| (group, group.plan.children)).collect();
        self.record_pictures(cmd, &parts, Picture::Children);
    }

    /// Records a round of the fit of opacities and colours.
    fn record_correction(&self, cmd: &mut Commands, groups: &[Waiting], round: usize) {
        let parts: Vec<_> = groups.iter().map(|group| (group, group.plan.corrections[round])).collect();
        self.record_pictures(cmd, &parts, Picture::Parents);
        self.record_comparison(cmd, &parts, false);
        stage(cmd, "correct", &parts, |cmd, (Waiting { workspace, .. }, part)| {
            let Workspace { sums, states, parents: Drawn { nodes, used, .. }, .. } = workspace;
            let push = CorrectPush { nodes: part.nodes, views: part.views, most_factor: MOST_FACTOR as f32 };
            let bindings = CorrectBindings { sums, nodes, states, used };
            cmd.dispatch(&self.correct, bindings, push, DispatchSize::Invocations(part.nodes.into()));
        });
    }

    /// Records a round of the fit of shapes, of the groups that have it.
    fn record_shapes(&self, cmd: &mut Commands, groups: &[Waiting], round: usize) {
        let with_round = groups.iter().filter_map(|group| Some((group, group.plan.shapes.get(round)?.1)));
        let parts: Vec<_> = with_round.collect();
        self.record_pictures(cmd, &parts, Picture::Slopes);
        stage(cmd, "gradient", &parts, |cmd, (group, part)| self.record_gradient(cmd, &group.workspace, *part));
        stage(cmd, "step", &parts, |cmd, (group, part)| self.record_step(cmd, group, round, *part));
    }

    /// Records the pictures of the fitted parents, and their errors.
    fn record_measurement(&self, cmd: &mut Commands, groups: &[Waiting]) {
        let parts: Vec<_> = groups.iter().map(|group| (group, group.plan.measured)).collect();
        self.record_pictures(cmd, &parts, Picture::Parents);
        self.record_comparison(cmd, &parts, true);
    }

    fn record_pictures(&self, cmd: &mut Commands, parts: &[GroupPart], picture: Picture) {
        let is_of_children = picture == Picture::Children;
        stage(cmd, "project", parts, |cmd, (group, part)| {
            let Workspace { views, rows, weights, .. } = &group.workspace;
            let Drawn { nodes, sh, splats, spans, depths, used, .. } = group.drawn(picture);
            let bindings = ProjectBindings { views, nodes, sh, splats, spans, depths, rows, used };
            let push = ProjectPush {
                nodes: part.nodes,
                coefficients: group.plan.coefficients,
                first_view: part.first_view,
                views: part.views,
                record_capacity: rows.len() as u32,
                weight_capacity: if is_of_children { u32::MAX } else { weights.len() as u32 },
            };
            let stage = &self.project[usize::from(!is_of_children)];
            cmd.dispatch(stage, bindings, push, part.groups(WORKGROUP));
        });
        stage(cmd, "rank", parts, |cmd, (group, part)| {
            let Drawn { depths, order, .. } = group.drawn(picture);
            let push = RankPush { nodes: part.nodes, views: part.views };
            cmd.dispatch(&self.rank, RankBindings { depths, order }, push, part.groups(WORKGROUP));
        });
        stage(cmd, "blend", parts, |cmd, (group, part)| {
            let Workspace { views, rows, pictures, drawn, covered, weights, slopes, values, .. } = &group.workspace;
            let Drawn { splats, spans, order, .. } = group.drawn(picture);
            let pictures = if picture == Picture::Parents { drawn } else { pictures };
            let bindings = BlendBindings {
                views,
                splats,
                spans,
                rows,
                order,
                pictures,
                weights,
                slopes,
                by_colours: values,
                covered,
            };
            let Part { nodes, first_view, views, tiles } = *part;
            let push = BlendPush { nodes, first_view, views, tiles, alpha_max: ALPHA_MAX, clamped: CLAMPED };
            cmd.dispatch(&self.blend[picture as usize], bindings, push, part.all_tiles());
        });
    }

    /// Records the comparison of pictures and the sums over the pixels of each node, for the fit of opacities and
    /// colours or for errors.
    fn record_comparison(&self, cmd: &mut Commands, parts: &[GroupPart], measures: bool) {
        stage(cmd, "compare", parts, |cmd, (group, part)| {
            let Workspace { views, pictures: expected, drawn, covered, values, tiles, .. } = &group.workspace;
            let bindings = CompareBindings { views, expected, drawn, covered, values, tiles };
            let push = ComparePush {
                first_view: part.first_view,
                views: part.views,
                tiles: part.tiles,
                least_alpha: LEAST_ALPHA,
                least_covered: LEAST_COVERED,
            };
            cmd.dispatch(&self.compare[usize::from(measures)], bindings, push, part.all_tiles());
        });
        stage(cmd, "sum", parts, |cmd, (group, part)| {
            let Workspace { views, rows, weights, values, sums, .. } = &group.workspace;
            let bindings = SumBindings { views, spans: &group.workspace.parents.spans, rows, weights, values, sums };
            let push = SumPush { nodes: part.nodes, first_view: part.first_view, views: part.views };
            cmd.dispatch(&self.sum[usize::from(measures)], bindings, push, part.groups(WORKGROUP / FIT_LANES));
        });
    }

    fn record_gradient(&self, cmd: &mut Commands, workspace: &Workspace, part: Part) {
        let Workspace { views, rows, weights, slopes, values: by_colours, gradients, .. } = workspace;
        let Drawn { nodes, splats, spans, .. } = &workspace.parents;
        let bindings = GradientBindings { views, nodes, splats, spans, rows, weights, slopes, by_colours, gradients };
        let push = GradientPush { nodes: part.nodes, first_view: part.first_view, views: part.views };
        cmd.dispatch(&self.gradient, bindings, push, part.groups(WORKGROUP / FIT_LANES));
    }

    fn record_step(&self, cmd: &mut Commands, group: &Waiting, round: usize, part: Part) {
        let Workspace { states, gradients, parents: Drawn { nodes, used, .. }, .. } = &group.workspace;
        let ((round, _), (low, high)) = (group.plan.shapes[round], group.plan.bounds);
        let push = StepPush {
            nodes: part.nodes,
            views: part.views,
            low,
            high,
            replaced: REPLACED,
            filled: round.filled,
            step_length: round.length,
            least_gradient: LEAST_GRADIENT,
            most_change: MOST_CHANGE,
        };
        let bindings = StepBindings { gradients, nodes, states, used };
        cmd.dispatch(&self.step, bindings, push, DispatchSize::Invocations(part.nodes.into()));
    }
}

/// Records a stage of all groups, and a barrier.
fn stage<T>(cmd: &mut Commands, name: &'static str, parts: &[T], record: impl Fn(&mut Commands, &T)) {
    cmd.scope(name, |cmd| parts.iter().for_each(|part| record(cmd, part)));
    cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{DeviceChoice, Validation};
    use crate::procedural::Procedural;
    use crate::scene::along_curve;

    /// On a device, nodes get the same bits as on the host, in groups one after another and at the same time.
    #[test]
    fn nodes_are_those_of_the_host() {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let fitter = DeviceFitter::new(&device).unwrap();
        let fit_both = |children: Nodes, shape_rounds: u32| {
            let [expected, found] = [None, Some(&fitter as &dyn Fitter)]
                .map(|fitter| simplify(&children, children.len() / 2, 0.0, FitOptions { shape_rounds, fitter }));
            let differ = expected.nodes.nodes.iter().zip(&found.nodes.nodes).filter(|(a, b)| a != b);
            let first: Vec<_> = differ.clone().take(1).collect();
            assert!(first.is_empty(), "{} of {} nodes differ: {first:?}", differ.count(), found.nodes.len());
            assert!(expected == found, "colours or the reference width differ");
        };
        let group = |scene: &str, nodes: std::ops::Range<usize>| {
            let gaussians = Procedural::parse(scene).unwrap().unwrap().make().unwrap().gaussians;
            Nodes::of(&gaussians, along_curve(gaussians.means())[nodes].iter().map(|index| *index as usize))
        };
        // More rounds than have directions of their own; wide nodes.
        for (scene, nodes, rounds) in
            [("cactus:60000", 40_000..40_700, 9), ("town:50000", 45_056..46_500, 1), ("town:50000", 20_000..24_096, 0)]
        {
            fit_both(group(scene, nodes), rounds);
        }
        std::thread::scope(|threads| {
            for (first, rounds) in [(0, 2), (20_000, 1), (50_000, 3)] {
                threads.spawn(move || fit_both(group("cactus:60000", first..first + 500), rounds));
            }
        });
        let failure = fitter.take_failure();
        assert!(failure.is_none(), "{failure:?}");
    }

    /// Groups for which memory is too small are left to the host.
    #[test]
    fn groups_without_memory_are_left() {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        // The sample fits.
        let device = device.with_small_limit(64 << 20).unwrap();
        let fitter = DeviceFitter::new(&device).unwrap();
        let gaussians = Procedural::parse("town:50000").unwrap().unwrap().make().unwrap().gaussians;
        let children =
            Nodes::of(&gaussians, along_curve(gaussians.means())[..4096].iter().map(|index| *index as usize));
        let [expected, found] = [None, Some(&fitter as &dyn Fitter)]
            .map(|fitter| simplify(&children, 2048, 0.0, FitOptions { shape_rounds: 9, fitter }));
        assert!(expected == found);
        let failure = fitter.take_failure().expect("it does not fit").to_string();
        assert!(failure.contains("bytes of `"), "{failure}");
    }
}
