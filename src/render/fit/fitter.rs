//! Fits the shapes of groups of nodes. Groups that wait at the same time are fitted together, so that the device has
//! work for all of its processors.

use std::collections::VecDeque;
use std::iter::once;
use std::mem::{forget, replace, take};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Error, Result, anyhow, ensure};

use super::workspace::{Drawn, Part, Plan, Workspace};
use crate::gpu::{Access, Commands, Device, DispatchSize, Feature, InFlight, Stage};
use crate::lod::{
    CLAMPED, Descent, Fitter, LEAST_GRADIENT, MOST_CHANGE, MOST_DEVIATIONS, Node, Nodes, PER_ALPHA_MIN, REPLACED,
    ShapeFit, simplify,
};
use crate::render::shaders::FitNode;
use crate::render::shaders::fit::*;
use crate::rules::{ALPHA_MAX, ALPHA_MIN};

// Numbers that the host and the shaders both have.
const _: () = assert!(FIT_ALPHA_MIN == ALPHA_MIN && FIT_PER_ALPHA_MIN == PER_ALPHA_MIN);
const _: () = assert!(FIT_MOST_DEVIATIONS as f64 == MOST_DEVIATIONS);

/// Most groups in one submission. Most take some 0.1 GB of device memory.
const MOST_GROUPS: usize = 16;
/// Most rounds in one submission: a slow device must not keep a desktop waiting for long.
const MOST_ROUNDS: usize = 4;

/// Fits shapes on a device, with the bits of the host.
pub struct ShapeFitter {
    device: Device,
    stages: Stages,
    idle: Mutex<Idle>,
    freed: Condvar,
    waiting: Mutex<Vec<Group>>,
    /// Held by the thread that submits groups.
    turn: Mutex<()>,
    /// Why groups were left to the host, by the first of them.
    failure: Mutex<Option<Error>>,
}

#[derive(Default)]
struct Idle {
    workspaces: Vec<Workspace>,
    /// Workspaces that were made, idle or not.
    made: usize,
}

/// A group that waits, and the upload of its nodes.
struct Group {
    workspace: Workspace,
    plan: Plan,
    upload: InFlight,
    finished: Arc<Mutex<Option<Finished>>>,
}

/// The workspace of a group and its fitted nodes, or none if they did not fit into the workspace.
type Finished = (Workspace, Result<Option<Vec<FitNode>>>);

/// A workspace that is not idle. If it is lost, another one may be made.
struct Lent<'f>(&'f ShapeFitter);

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        locked(&self.0.idle).made -= 1;
        self.0.freed.notify_one();
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ShapeFitter {
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
            waiting: Mutex::default(),
            turn: Mutex::default(),
            failure: Mutex::default(),
        };
        let [found, expected] = [Some(&fitter as &dyn Fitter), None]
            .map(|fitter| simplify(&sample(), SAMPLE / 2, 0.0, ShapeFit { rounds: 2, fitter }).nodes);
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

    /// Fits the parents. Lists that are too small grow.
    fn try_fit(&self, descent: &Descent, parents: &mut Nodes) -> Result<()> {
        let (mut workspace, lent) = self.take_workspace()?;
        loop {
            let fitted = match workspace.load(&self.device, descent, parents) {
                Ok((plan, upload)) => {
                    let finished = self.run(workspace, plan, upload);
                    let (used, fitted) = finished.context("the thread that submits groups has panicked")?;
                    workspace = used;
                    fitted
                }
                Err(error) => Err(error),
            };
            let done = match fitted {
                Ok(Some(fitted)) => {
                    for (i, node) in fitted.iter().take(parents.len()).enumerate() {
                        let FitNode { mean, rotation, scale, opacity, size, colour } = *node;
                        parents.nodes[i] = Node { mean, rotation, scale, opacity, size, ..parents.nodes[i] };
                        parents.sh_mut(i)[0] = colour;
                    }
                    Ok(())
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

    /// Runs a group, and those that wait with it, unless another thread has done so. `None` if that thread has
    /// panicked.
    fn run(&self, workspace: Workspace, plan: Plan, upload: InFlight) -> Option<Finished> {
        let finished = Arc::default();
        locked(&self.waiting).push(Group { workspace, plan, upload, finished: Arc::clone(&finished) });
        let turn = locked(&self.turn);
        if locked(&finished).is_none() {
            let groups = take(&mut *locked(&self.waiting));
            self.run_together(groups);
        }
        drop(turn);
        locked(&finished).take()
    }

    fn run_together(&self, groups: Vec<Group>) {
        let mut found: VecDeque<Result<_>> = match self.submit(&groups) {
            Ok(found) => found.into_iter().map(Ok).collect(),
            Err(error) => {
                let copies: Vec<_> = (1..groups.len()).map(|_| Err(anyhow!("{error:#}"))).collect();
                once(Err(error)).chain(copies).collect()
            }
        };
        for Group { workspace, upload, finished, .. } in groups {
            // This waits if the submission has failed.
            drop(upload);
            let fitted = found.pop_front().expect("each group has a result");
            *locked(&finished) = Some((workspace, fitted));
        }
    }

    /// The fitted nodes of each group, or none if they did not fit into its workspace. Waits for the device.
    fn submit(&self, groups: &[Group]) -> Result<Vec<Option<Vec<FitNode>>>> {
        let mut cmd = Commands::new(&self.device)?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        self.stages.record_children(&mut cmd, groups);
        let (mut earlier, rounds) = (Vec::new(), groups.iter().map(|group| group.plan.rounds.len()).max().unwrap_or(0));
        for first in (0..rounds).step_by(MOST_ROUNDS) {
            let end = rounds.min(first + MOST_ROUNDS);
            (first..end).for_each(|round| self.stages.record_round(&mut cmd, groups, round));
            if end < rounds {
                earlier.push(replace(&mut cmd, Commands::new(&self.device)?).submit()?);
            }
        }
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let mut read = Vec::new();
        for Group { workspace, .. } in groups {
            let used = [cmd.read(&workspace.children.used)?, cmd.read(&workspace.parents.used)?];
            read.push((used, cmd.read(&workspace.parents.nodes)?));
        }
        let results = cmd.submit()?.wait()?;
        let fitted = read.iter().map(|(used, nodes)| {
            let has_all = used.iter().all(|used| results.view(used)[0].is_full == 0);
            has_all.then(|| results.view(nodes).to_vec())
        });
        Ok(fitted.collect())
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

impl Fitter for ShapeFitter {
    fn fit(&self, descent: &Descent, parents: &mut Nodes) -> bool {
        let fitted = self.try_fit(descent, parents);
        fitted.map_err(|error| _ = locked(&self.failure).get_or_insert(error)).is_ok()
    }
}

/// The stages of a round, and of the pictures of children.
struct Stages {
    /// One for children and one for parents, which keeps weights for the way back.
    project: [Stage<Project>; 2],
    rank: Stage<Rank>,
    /// One for children and one for parents, which compares with the pictures of the children.
    blend: [Stage<Blend>; 2],
    gradient: Stage<Gradient>,
    step: Stage<Step>,
}

/// Invocations of a workgroup.
const WORKGROUP: u32 = 256;
const _: () = assert!(FIT_TILE * FIT_TILE == WORKGROUP);

impl Stages {
    fn new(device: &Device) -> Result<Self> {
        let project = |keeps_weights| Stage::new(device, &ProjectConstants { keeps_weights });
        let blend = |has_expected| Stage::new(device, &BlendConstants { has_expected });
        Ok(Self {
            project: [project(false)?, project(true)?],
            rank: Stage::new(device, &())?,
            blend: [blend(false)?, blend(true)?],
            gradient: Stage::new(device, &())?,
            step: Stage::new(device, &())?,
        })
    }

    fn record_children(&self, cmd: &mut Commands, groups: &[Group]) {
        let all = groups.iter().map(|group| (group, &group.workspace.children, group.plan.children));
        self.record_pictures(cmd, &all.collect::<Vec<_>>(), 0);
    }

    /// Records a round of the groups that have it.
    fn record_round(&self, cmd: &mut Commands, groups: &[Group], round: usize) {
        let with_round = groups.iter().filter(|group| round < group.plan.rounds.len());
        let parts: Vec<_> = with_round.map(|group| (group, &group.workspace.parents, group.plan.part(round))).collect();
        self.record_pictures(cmd, &parts, 1);
        stage(cmd, "gradient", &parts, |cmd, (group, _, part)| self.record_gradient(cmd, &group.workspace, *part));
        stage(cmd, "step", &parts, |cmd, (group, _, part)| self.record_step(cmd, group, round, *part));
    }

    /// Records the pictures of children (0) or parents (1).
    fn record_pictures(&self, cmd: &mut Commands, parts: &[(&Group, &Drawn, Part)], kind: usize) {
        stage(cmd, "project", parts, |cmd, (group, drawn, part)| {
            let Workspace { views, rows, weights, .. } = &group.workspace;
            let Drawn { nodes, sh, splats, spans, depths, used, .. } = drawn;
            let bindings = ProjectBindings { views, nodes, sh, splats, spans, depths, rows, used };
            let push = ProjectPush {
                nodes: part.nodes,
                coefficients: group.plan.coefficients,
                first_view: part.first_view,
                views: part.views,
                record_capacity: rows.len() as u32,
                weight_capacity: if kind == 0 { u32::MAX } else { weights.len() as u32 },
            };
            cmd.dispatch(&self.project[kind], bindings, push, part.groups(WORKGROUP));
        });
        stage(cmd, "rank", parts, |cmd, (_, Drawn { depths, order, .. }, part)| {
            let push = RankPush { nodes: part.nodes, views: part.views };
            cmd.dispatch(&self.rank, RankBindings { depths, order }, push, part.groups(WORKGROUP));
        });
        stage(cmd, "blend", parts, |cmd, (group, drawn, part)| {
            let Workspace { views, rows, pictures, weights, slopes, by_colours, .. } = &group.workspace;
            let Drawn { splats, spans, order, .. } = drawn;
            let bindings = BlendBindings { views, splats, spans, rows, order, pictures, weights, slopes, by_colours };
            let Part { nodes, first_view, views, tiles } = *part;
            let push = BlendPush { nodes, first_view, views, tiles, alpha_max: ALPHA_MAX, clamped: CLAMPED };
            cmd.dispatch(&self.blend[kind], bindings, push, DispatchSize::Groups(u64::from(views) * u64::from(tiles)));
        });
    }

    fn record_gradient(&self, cmd: &mut Commands, workspace: &Workspace, part: Part) {
        let Workspace { views, rows, weights, slopes, by_colours, gradients, .. } = workspace;
        let Drawn { nodes, splats, spans, .. } = &workspace.parents;
        let bindings = GradientBindings { views, nodes, splats, spans, rows, weights, slopes, by_colours, gradients };
        let push = GradientPush { nodes: part.nodes, first_view: part.first_view, views: part.views };
        cmd.dispatch(&self.gradient, bindings, push, part.groups(WORKGROUP / FIT_LANES));
    }

    fn record_step(&self, cmd: &mut Commands, group: &Group, round: usize, part: Part) {
        let Workspace { states, gradients, parents: Drawn { nodes, used, .. }, .. } = &group.workspace;
        let (round, (low, high)) = (group.plan.rounds[round], group.plan.bounds);
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
    fn shapes_are_those_of_the_host() {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let fitter = ShapeFitter::new(&device).unwrap();
        let fit_both = |children: Nodes, rounds: u32| {
            let [expected, found] = [None, Some(&fitter as &dyn Fitter)]
                .map(|fitter| simplify(&children, children.len() / 2, 0.0, ShapeFit { rounds, fitter }).nodes);
            let differ = expected.nodes.iter().zip(&found.nodes).filter(|(a, b)| a != b);
            let first: Vec<_> = differ.clone().take(1).collect();
            assert!(first.is_empty(), "{} of {} nodes differ: {first:?}", differ.count(), found.len());
            assert!(expected.sh == found.sh, "colours differ");
            let merged = simplify(&children, children.len() / 2, 0.0, ShapeFit::default()).nodes;
            assert!(found != merged, "nothing is fitted");
        };
        let group = |scene: &str, nodes: std::ops::Range<usize>| {
            let gaussians = Procedural::parse(scene).unwrap().unwrap().make().unwrap().gaussians;
            Nodes::of(&gaussians, along_curve(gaussians.means())[nodes].iter().map(|index| *index as usize))
        };
        // More rounds than have directions of their own; wide nodes.
        for (scene, nodes, rounds) in [("cactus:60000", 40_000..40_700, 9), ("town:50000", 45_056..46_500, 1)] {
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
        let fitter = ShapeFitter::new(&device).unwrap();
        let gaussians = Procedural::parse("town:50000").unwrap().unwrap().make().unwrap().gaussians;
        let children =
            Nodes::of(&gaussians, along_curve(gaussians.means())[..4096].iter().map(|index| *index as usize));
        let [expected, found] = [None, Some(&fitter as &dyn Fitter)]
            .map(|fitter| simplify(&children, 2048, 0.0, ShapeFit { rounds: 9, fitter }).nodes);
        assert!(expected == found);
        let failure = fitter.take_failure().expect("it does not fit").to_string();
        assert!(failure.contains("bytes of `"), "{failure}");
    }
}
