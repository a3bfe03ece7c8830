//! The types of settings, as values of knobs.

use std::fmt;

use super::Storage;
use crate::rules::{Footprint, Order, Response};

/// A value of a knob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    Number(f32),
    Count(u32),
    Name(&'static str),
    Flag(bool),
}

/// As it is written on the command line.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Count(count) => count.fmt(f),
            Self::Name(name) => name.fmt(f),
            Self::Flag(flag) => flag.fmt(f),
        }
    }
}

/// A type of settings of [`Options`].
pub trait Setting: Copy {
    fn value(self) -> Value;
    /// Panics if the value is of another kind.
    fn of(value: Value) -> Self;
}

macro_rules! setting {
    ($type:ty, $kind:ident) => {
        impl Setting for $type {
            fn value(self) -> Value {
                Value::$kind(self)
            }

            fn of(value: Value) -> Self {
                match value {
                    Value::$kind(value) => value,
                    other => panic!("a knob was set to a value of another kind: {other:?}"),
                }
            }
        }
    };
    ($type:ty) => {
        impl Setting for $type {
            fn value(self) -> Value {
                let named = Self::NAMES.iter().find(|(_, named)| *named == self);
                Value::Name(named.expect("every value of the enum has a name").0)
            }

            fn of(value: Value) -> Self {
                match value {
                    Value::Name(name) => name.parse().expect("a knob is set to one of its names"),
                    other => panic!("a knob was set to a value of another kind: {other:?}"),
                }
            }
        }
    };
}

setting!(f32, Number);
setting!(u32, Count);
setting!(bool, Flag);
setting!(Storage);
setting!(Order);
setting!(Response);
setting!(Footprint);
