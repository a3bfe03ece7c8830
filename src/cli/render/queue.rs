//! The views of a run that are left to draw: devices take them one by one, and give back what they could not finish.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};

/// The tasks of a run, taken by several threads.
pub(super) struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    left: VecDeque<T>,
    /// Tasks that were taken and are not finished.
    taken: usize,
    /// Some task was given back.
    was_given_back: bool,
    is_stopped: bool,
}

impl<T> Queue<T> {
    pub fn new(tasks: impl IntoIterator<Item = T>) -> Self {
        let state = State { left: tasks.into_iter().collect(), taken: 0, was_given_back: false, is_stopped: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// The next task, if one is left.
    pub fn try_take(&self) -> Option<T> {
        self.state().take()
    }

    /// The next task. Waits while none is left but others may give theirs back. `None` if all are finished, or the
    /// queue is stopped.
    pub fn take(&self) -> Option<T> {
        let is_open = |state: &mut State<T>| !state.is_stopped && state.left.is_empty() && state.taken > 0;
        self.changed.wait_while(self.state(), is_open).expect("no holder of the queue panics").take()
    }

    /// Waits until a task is left that was given back: true. False if all are finished before, or the queue is stopped.
    pub fn waits_for_loss(&self) -> bool {
        let is_left = |state: &mut State<T>| {
            let is_done = state.left.is_empty() && state.taken == 0;
            !state.is_stopped && !is_done && (!state.was_given_back || state.left.is_empty())
        };
        let state = self.changed.wait_while(self.state(), is_left).expect("no holder of the queue panics");
        !state.is_stopped && !state.left.is_empty()
    }

    /// A task that was taken is finished.
    pub fn finish(&self) {
        self.state().taken -= 1;
        self.changed.notify_all();
    }

    /// Gives a task back that was taken. It is the next to be taken.
    pub fn give_back(&self, task: T) {
        let mut state = self.state();
        state.taken -= 1;
        state.was_given_back = true;
        state.left.push_front(task);
        self.changed.notify_all();
    }

    /// No task is given out any more.
    pub fn stop(&self) {
        self.state().is_stopped = true;
        self.changed.notify_all();
    }

    pub fn is_open(&self) -> bool {
        !self.state().is_stopped
    }

    /// True if tasks are left that nobody has taken.
    pub fn has_left(&self) -> bool {
        !self.state().left.is_empty()
    }

    /// Stops when dropped while its thread panics, so that nobody waits for what it had taken.
    pub fn stopped_by_panics(&self) -> impl Drop {
        StopOnPanic(self)
    }

    /// True if tasks are left that nobody has taken, although the queue was not stopped.
    pub fn is_abandoned(&self) -> bool {
        let state = self.state();
        !state.is_stopped && !state.left.is_empty()
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().expect("no holder of the queue panics")
    }
}

struct StopOnPanic<'q, T>(&'q Queue<T>);

impl<T> Drop for StopOnPanic<'_, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

impl<T> State<T> {
    fn take(&mut self) -> Option<T> {
        let task = self.left.pop_front().filter(|_| !self.is_stopped)?;
        self.taken += 1;
        Some(task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of the workers fails with tasks in its hands: the others do them.
    #[test]
    fn every_task_is_finished_although_a_worker_is_lost() {
        let queue = Queue::new(0..100);
        let done = Mutex::new(Vec::new());
        let work = &|lost_after: usize| {
            let mut own = 0;
            while let Some(task) = queue.take() {
                own += 1;
                if own > lost_after {
                    // It had taken two.
                    queue.try_take().into_iter().for_each(|other| queue.give_back(other));
                    return queue.give_back(task);
                }
                done.lock().unwrap().push(task);
                queue.finish();
            }
        };
        std::thread::scope(|threads| {
            for lost_after in [3, 7, usize::MAX] {
                threads.spawn(move || work(lost_after));
            }
        });
        let mut done = done.into_inner().unwrap();
        done.sort_unstable();
        assert_eq!(done, Vec::from_iter(0..100));
        assert!(!queue.is_abandoned());
    }

    #[test]
    fn who_stands_by_waits_until_a_task_is_given_back() {
        let queue = Queue::new(0..5);
        std::thread::scope(|threads| {
            let idle = threads.spawn(|| queue.waits_for_loss());
            for task in 0..5 {
                assert_eq!(queue.take(), Some(task));
                queue.finish();
            }
            assert!(!idle.join().unwrap());
        });
        let queue = Queue::new(0..5);
        std::thread::scope(|threads| {
            let idle = threads.spawn(|| queue.waits_for_loss());
            assert_eq!([queue.take(), queue.take()], [Some(0), Some(1)]);
            queue.give_back(1);
            assert!(idle.join().unwrap());
            assert_eq!(queue.take(), Some(1));
        });
    }

    #[test]
    fn a_stopped_queue_gives_nothing_out() {
        let queue = Queue::new(0..3);
        assert_eq!(queue.take(), Some(0));
        queue.stop();
        assert_eq!([queue.take(), queue.try_take()], [None; 2]);
        assert!(!queue.is_abandoned());
        let abandoned = Queue::new(0..3);
        assert!(abandoned.is_abandoned());
    }
}
