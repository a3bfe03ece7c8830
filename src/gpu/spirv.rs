//! Reads the interface of a compute shader from SPIR-V: bindings, push constants, specialization constants.
//!
//! `build.rs` includes this file and turns an [`Interface`] into Rust types; the library does only with the feature
//! `reload`.

use std::collections::HashMap;

use anyhow::{Context, Result, bail, ensure};
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, ExecutionMode, Op, StorageClass, Word};

/// The interface of one shader.
#[derive(Debug, PartialEq)]
pub struct Interface {
    /// Invocations in a workgroup, x y z.
    pub workgroup: [u32; 3],
    /// Sorted by binding number.
    pub bindings: Vec<Binding>,
    /// The push-constant block, if there is one.
    pub push: Option<Vec<Member>>,
    /// Sorted by `constant_id`.
    pub constants: Vec<Constant>,
    /// Every struct that a binding or the push block is made of, innermost first.
    pub structs: Vec<Struct>,
}

#[derive(Debug, PartialEq)]
pub struct Binding {
    pub number: u32,
    /// The variable's name, or the name of the only member of a block without an instance name.
    pub name: String,
    /// Descriptors: 1, or the length of a descriptor array.
    pub count: u32,
    pub kind: Kind,
    pub reads: bool,
    pub writes: bool,
}

#[derive(Debug, PartialEq)]
pub enum Kind {
    /// A storage buffer of elements of this type.
    Buffer(Type),
    /// A 2-D storage image.
    Image,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Type {
    U32,
    I32,
    F32,
    U64,
    Array(Box<Type>, u32),
    Struct(String),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Struct {
    pub name: String,
    pub members: Vec<Member>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    pub name: String,
    pub ty: Type,
}

#[derive(Debug, PartialEq)]
pub struct Constant {
    pub id: u32,
    pub name: String,
    pub default: Value,
}

/// A specialization constant's default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    Bool(bool),
    U32(u32),
    I32(i32),
    F32(f32),
}

/// Reads the interface of a compute module that still has its names (`OpName`).
pub fn reflect(words: &[u32]) -> Result<Interface> {
    let module = rspirv::dr::load_words(words).map_err(|e| anyhow::anyhow!("not SPIR-V: {e}"))?;
    Reflector::new(&module)?.interface()
}

struct Reflector<'m> {
    module: &'m Module,
    /// Types, constants and variables by result id.
    globals: HashMap<Word, &'m Instruction>,
    names: HashMap<Word, &'m str>,
    member_names: HashMap<(Word, u32), &'m str>,
    structs: Vec<Struct>,
}

impl<'m> Reflector<'m> {
    fn new(module: &'m Module) -> Result<Self> {
        let mut names = HashMap::new();
        let mut member_names = HashMap::new();
        for name in &module.debug_names {
            match (name.class.opcode, &name.operands[..]) {
                (Op::Name, [Operand::IdRef(id), Operand::LiteralString(text)]) => {
                    names.insert(*id, text.as_str());
                }
                (Op::MemberName, [Operand::IdRef(id), Operand::LiteralBit32(i), Operand::LiteralString(text)]) => {
                    member_names.insert((*id, *i), text.as_str());
                }
                _ => {}
            }
        }
        let globals = module.types_global_values.iter().filter_map(|i| Some((i.result_id?, i))).collect();
        Ok(Self { module, globals, names, member_names, structs: Vec::new() })
    }

    fn interface(mut self) -> Result<Interface> {
        let mut bindings = Vec::new();
        let mut push = None;
        for variable in self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable) {
            let Operand::StorageClass(class) = variable.operands[0] else { continue };
            let id = variable.result_id.context("a variable has an id")?;
            let pointee = self.pointee(variable.result_type.context("a variable has a type")?)?;
            match class {
                StorageClass::StorageBuffer | StorageClass::UniformConstant => {
                    let number = self
                        .decoration(id, Decoration::Binding)
                        .with_context(|| format!("`{}` has no binding number", self.name(id)))?;
                    bindings.push(self.binding(id, number, pointee)?);
                }
                StorageClass::PushConstant => push = Some(self.members(pointee)?),
                StorageClass::Uniform => {
                    bail!("`{}`: uniform buffers are not supported, use push constants", self.name(id))
                }
                _ => {}
            }
        }
        bindings.sort_by_key(|b| b.number);
        for pair in bindings.windows(2) {
            ensure!(
                pair[0].number != pair[1].number,
                "`{}` and `{}` share binding {}",
                pair[0].name,
                pair[1].name,
                pair[0].number
            );
            let twin = bindings.iter().filter(|b| b.name == pair[0].name).count();
            ensure!(twin == 1, "two bindings are named `{}`", pair[0].name);
        }
        let constants = self.constants()?;
        Ok(Interface { workgroup: self.workgroup()?, bindings, push, constants, structs: self.structs })
    }

    fn binding(&mut self, variable: Word, number: u32, pointee: Word) -> Result<Binding> {
        let (count, block) = match self.global(pointee)? {
            i if i.class.opcode == Op::TypeArray => (self.constant(id_ref(i, 1)?)?, id_ref(i, 0)?),
            _ => (1, pointee),
        };
        let instruction = self.global(block)?;
        match instruction.class.opcode {
            Op::TypeImage => Ok(Binding {
                number,
                name: self.name(variable).to_owned(),
                count,
                kind: Kind::Image,
                reads: !self.has(variable, Decoration::NonReadable),
                writes: !self.has(variable, Decoration::NonWritable),
            }),
            Op::TypeStruct => {
                let member_name = self.member_name(block, 0)?.to_owned();
                ensure!(
                    instruction.operands.len() == 1,
                    "the block of `{member_name}` has {} members; a storage block has one, an array or a struct",
                    instruction.operands.len()
                );
                let content = id_ref(instruction, 0)?;
                let (element, stride) = match self.global(content)? {
                    i if i.class.opcode == Op::TypeRuntimeArray => (
                        id_ref(i, 0)?,
                        Some(self.decoration(content, Decoration::ArrayStride).context("an array has a stride")?),
                    ),
                    _ => (content, None),
                };
                let ty = self.ty(element).with_context(|| format!("binding `{member_name}`"))?;
                if let Some(stride) = stride {
                    ensure!(
                        stride == self.size(&ty),
                        "binding `{member_name}`: elements are padded to {stride} bytes; use `scalar` layout"
                    );
                }
                let name = match self.name(variable) {
                    "" => member_name,
                    named => named.to_owned(),
                };
                let flag = |decoration| {
                    self.has(variable, decoration) || self.member_decoration(block, 0, decoration).is_some()
                };
                let (reads, writes) = (!flag(Decoration::NonReadable), !flag(Decoration::NonWritable));
                Ok(Binding { number, name, count, kind: Kind::Buffer(ty), reads, writes })
            }
            other => bail!("`{}`: {other:?} bindings are not supported", self.name(variable)),
        }
    }

    /// The members of a struct laid out without padding.
    fn members(&mut self, structure: Word) -> Result<Vec<Member>> {
        let name = self.name(structure).to_owned();
        let mut members = Vec::new();
        let mut end = 0;
        for index in 0..self.global(structure)?.operands.len() {
            let id = id_ref(self.global(structure)?, index)?;
            let index = index as u32;
            let member_name = self.member_name(structure, index)?.to_owned();
            let ty = self.ty(id).with_context(|| format!("`{name}.{member_name}`"))?;
            let offset = self
                .member_decoration(structure, index, Decoration::Offset)
                .with_context(|| format!("`{name}.{member_name}` has no offset"))?;
            ensure!(
                offset == end,
                "padding before `{name}.{member_name}`: it is at byte {offset}, its predecessor ends at {end}; \
                 use `scalar` layout and order members by alignment"
            );
            end = offset + self.size(&ty);
            members.push(Member { name: member_name, ty });
        }
        let alignment = members.iter().map(|m| self.alignment(&m.ty)).max().unwrap_or(1);
        ensure!(end % alignment == 0, "padding at the end of `{name}`: {end} bytes aligned to {alignment}");
        Ok(members)
    }

    fn ty(&mut self, id: Word) -> Result<Type> {
        let instruction = self.global(id)?;
        let literal = |i: usize| match instruction.operands[i] {
            Operand::LiteralBit32(n) => n,
            _ => 0,
        };
        Ok(match instruction.class.opcode {
            Op::TypeInt if literal(0) == 32 && literal(1) == 0 => Type::U32,
            Op::TypeInt if literal(0) == 32 => Type::I32,
            Op::TypeInt if literal(0) == 64 && literal(1) == 0 => Type::U64,
            Op::TypeFloat if literal(0) == 32 => Type::F32,
            Op::TypeVector => Type::Array(Box::new(self.ty(id_ref(instruction, 0)?)?), literal(1)),
            Op::TypeArray => {
                let element = self.ty(id_ref(instruction, 0)?)?;
                let length = self.constant(id_ref(instruction, 1)?)?;
                let stride = self.decoration(id, Decoration::ArrayStride).context("an array has a stride")?;
                ensure!(
                    stride == self.size(&element),
                    "array elements are padded to {stride} bytes; use `scalar` layout"
                );
                Type::Array(Box::new(element), length)
            }
            Op::TypeStruct => {
                let name = self.name(id).to_owned();
                let structure = Struct { name: name.clone(), members: self.members(id)? };
                match self.structs.iter().find(|s| s.name == name) {
                    None => self.structs.push(structure),
                    Some(known) => ensure!(*known == structure, "two structs are named `{name}`"),
                }
                Type::Struct(name)
            }
            other => bail!("{other:?} is not a type that Rust can share without padding or conversion"),
        })
    }

    fn size(&self, ty: &Type) -> u32 {
        match ty {
            Type::U32 | Type::I32 | Type::F32 => 4,
            Type::U64 => 8,
            Type::Array(element, length) => self.size(element) * length,
            Type::Struct(name) => self.structure(name).members.iter().map(|m| self.size(&m.ty)).sum(),
        }
    }

    fn alignment(&self, ty: &Type) -> u32 {
        match ty {
            Type::U32 | Type::I32 | Type::F32 => 4,
            Type::U64 => 8,
            Type::Array(element, _) => self.alignment(element),
            Type::Struct(name) => self.structure(name).members.iter().map(|m| self.alignment(&m.ty)).max().unwrap_or(1),
        }
    }

    fn structure(&self, name: &str) -> &Struct {
        self.structs.iter().find(|s| s.name == name).expect("a struct is recorded before it is used")
    }

    fn constants(&self) -> Result<Vec<Constant>> {
        let mut constants = Vec::new();
        for instruction in &self.module.types_global_values {
            let Some(id) = instruction.result_id else { continue };
            let Some(constant_id) = self.decoration(id, Decoration::SpecId) else { continue };
            let bits = match instruction.operands.first() {
                Some(Operand::LiteralBit32(bits)) => *bits,
                _ => 0,
            };
            let default = match instruction.class.opcode {
                Op::SpecConstantTrue => Value::Bool(true),
                Op::SpecConstantFalse => Value::Bool(false),
                Op::SpecConstant => {
                    let ty = self.global(instruction.result_type.context("a constant has a type")?)?;
                    match (ty.class.opcode, &ty.operands[..]) {
                        (Op::TypeInt, [Operand::LiteralBit32(32), Operand::LiteralBit32(0)]) => Value::U32(bits),
                        (Op::TypeInt, [Operand::LiteralBit32(32), _]) => Value::I32(bits as i32),
                        (Op::TypeFloat, [Operand::LiteralBit32(32), ..]) => Value::F32(f32::from_bits(bits)),
                        _ => bail!("specialization constant `{}` is not 32 bits wide", self.name(id)),
                    }
                }
                other => bail!("specialization constant `{}` is an {other:?}", self.name(id)),
            };
            constants.push(Constant { id: constant_id, name: self.name(id).to_owned(), default });
        }
        constants.sort_by_key(|c| c.id);
        Ok(constants)
    }

    fn workgroup(&self) -> Result<[u32; 3]> {
        for mode in &self.module.execution_modes {
            let size: Vec<u32> = mode
                .operands
                .iter()
                .filter_map(|o| match o {
                    Operand::LiteralBit32(n) => Some(*n),
                    _ => None,
                })
                .collect();
            if mode.operands.contains(&Operand::ExecutionMode(ExecutionMode::LocalSize)) {
                return size.try_into().map_err(|_| anyhow::anyhow!("a local size has three numbers"));
            }
        }
        bail!("the workgroup size is not a literal `local_size`")
    }

    fn global(&self, id: Word) -> Result<&'m Instruction> {
        self.globals.get(&id).copied().with_context(|| format!("id {id} is undefined"))
    }

    fn pointee(&self, pointer: Word) -> Result<Word> {
        id_ref(self.global(pointer)?, 1)
    }

    fn constant(&self, id: Word) -> Result<u32> {
        match self.global(id)?.operands[..] {
            [Operand::LiteralBit32(n)] => Ok(n),
            _ => bail!("an array length is not a constant"),
        }
    }

    fn name(&self, id: Word) -> &'m str {
        self.names.get(&id).copied().unwrap_or("")
    }

    fn member_name(&self, structure: Word, index: u32) -> Result<&'m str> {
        self.member_names.get(&(structure, index)).copied().context("a member has no name: keep debug names")
    }

    fn has(&self, id: Word, decoration: Decoration) -> bool {
        self.decoration(id, decoration).is_some()
    }

    /// The first literal of a decoration of `id`, 0 for a decoration that carries none.
    fn decoration(&self, id: Word, decoration: Decoration) -> Option<u32> {
        self.find_decoration(Op::Decorate, &[Operand::IdRef(id), Operand::Decoration(decoration)])
    }

    fn member_decoration(&self, structure: Word, index: u32, decoration: Decoration) -> Option<u32> {
        let head = [Operand::IdRef(structure), Operand::LiteralBit32(index), Operand::Decoration(decoration)];
        self.find_decoration(Op::MemberDecorate, &head)
    }

    fn find_decoration(&self, op: Op, head: &[Operand]) -> Option<u32> {
        let found = self.module.annotations.iter().find(|a| a.class.opcode == op && a.operands.starts_with(head))?;
        Some(match found.operands.get(head.len()) {
            Some(Operand::LiteralBit32(n)) => *n,
            _ => 0,
        })
    }
}

fn id_ref(instruction: &Instruction, operand: usize) -> Result<Word> {
    match instruction.operands.get(operand) {
        Some(Operand::IdRef(id)) => Ok(*id),
        _ => bail!("{:?} lacks operand {operand}", instruction.class.opcode),
    }
}
