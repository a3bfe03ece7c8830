//! What `build.rs` reads from shaders, and what it refuses.

#[path = "../../src/gpu/spirv.rs"]
mod spirv;

use self::spirv::{Binding, Constant, Interface, Kind, Member, Struct, Type, Value, reflect};

fn try_reflect(body: &str) -> anyhow::Result<Interface> {
    let source = format!(
        "#version 460\n#extension GL_EXT_scalar_block_layout : require\n\
         #extension GL_EXT_shader_explicit_arithmetic_types_int64 : require\n{body}"
    );
    let mut options = shaderc::CompileOptions::new()?;
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(shaderc::SpirvVersion::V1_6);
    let kind = shaderc::ShaderKind::Compute;
    let module = shaderc::Compiler::new()?.compile_into_spirv(&source, kind, "test", "main", Some(&options))?;
    reflect(module.as_binary())
}

fn refusal(body: &str) -> String {
    format!("{:#}", try_reflect(body).expect_err("it is refused"))
}

const MAIN: &str = "layout(local_size_x = 64, local_size_y = 2) in; void main() {}";

#[test]
fn everything_a_shader_declares_is_read() {
    let interface = try_reflect(
        "struct Pair { vec3 a; float b; };
         struct Outer { Pair pairs[2]; uvec2 c; };
         layout(constant_id = 3) const float SLOPE = 0.5;
         layout(constant_id = 1) const bool FLAG = true;
         layout(constant_id = 2) const uint COUNT = 7;
         layout(binding = 4, rgba32f) uniform writeonly image2D image;
         layout(binding = 0, scalar) readonly buffer A { vec4 values[]; };
         layout(binding = 1, scalar) writeonly buffer B { Outer outers[]; };
         layout(binding = 2, scalar) buffer C { Pair pair; };
         layout(binding = 3, scalar) readonly buffer D { uint64_t words[]; } planes[5];
         layout(push_constant, scalar) uniform Push { Outer outer; uint n; } push;
         layout(local_size_x = 64, local_size_y = 2) in; void main() {}",
    );
    let pair = Struct { name: "Pair".into(), members: vec![member("a", floats(3)), member("b", Type::F32)] };
    let pairs = Type::Array(Box::new(Type::Struct("Pair".into())), 2);
    let c = Type::Array(Box::new(Type::U32), 2);
    let outer = Struct { name: "Outer".into(), members: vec![member("pairs", pairs), member("c", c)] };
    let buffer = |number, name: &str, count, ty, reads, writes| Binding {
        number,
        name: name.into(),
        count,
        kind: Kind::Buffer(ty),
        reads,
        writes,
    };
    let image = Binding { number: 4, name: "image".into(), count: 1, kind: Kind::Image, reads: false, writes: true };
    let mut interface = interface.unwrap();
    interface.structs.sort_by(|a, b| b.name.cmp(&a.name));
    let expected = Interface {
        workgroup: [64, 2, 1],
        bindings: vec![
            buffer(0, "values", 1, floats(4), true, false),
            buffer(1, "outers", 1, Type::Struct("Outer".into()), false, true),
            buffer(2, "pair", 1, Type::Struct("Pair".into()), true, true),
            buffer(3, "planes", 5, Type::U64, true, false),
            image,
        ],
        push: Some(vec![member("outer", Type::Struct("Outer".into())), member("n", Type::U32)]),
        constants: vec![
            Constant { id: 1, name: "FLAG".into(), default: Value::Bool(true) },
            Constant { id: 2, name: "COUNT".into(), default: Value::U32(7) },
            Constant { id: 3, name: "SLOPE".into(), default: Value::F32(0.5) },
        ],
        structs: vec![pair, outer],
    };
    assert_eq!(interface, expected);
}

fn member(name: &str, ty: Type) -> Member {
    Member { name: name.into(), ty }
}

fn floats(count: u32) -> Type {
    Type::Array(Box::new(Type::F32), count)
}

#[test]
fn padding_is_refused() {
    // std430 puts the float array's vec3 elements 16 bytes apart, and c behind a gap.
    let error = refusal(&format!("layout(binding = 0, std430) readonly buffer A {{ vec3 values[]; }}; {MAIN}"));
    assert!(error.contains("`values`") && error.contains("padded to 16 bytes"), "{error}");
    let error = refusal(&format!("layout(push_constant, std430) uniform P {{ float a; vec2 c; }} p; {MAIN}"));
    assert!(error.contains("padding before `P.c`"), "{error}");
    let error = refusal(&format!("layout(push_constant, scalar) uniform P {{ uint a; uint64_t c; }} p; {MAIN}"));
    assert!(error.contains("padding before `P.c`: it is at byte 8, its predecessor ends at 4"), "{error}");
    let error = refusal(&format!("layout(push_constant, scalar) uniform P {{ uint64_t c; uint a; }} p; {MAIN}"));
    assert!(error.contains("padding at the end of `P`"), "{error}");
}

#[test]
fn blocks_without_a_rust_type_are_refused() {
    for (declaration, expected) in [
        ("layout(binding = 0, scalar) buffer A { uint count; uint values[]; };", "has 2 members"),
        ("layout(binding = 0, std140) uniform A { uint count; };", "uniform buffers are not supported"),
        ("layout(binding = 0) uniform sampler2D tex;", "not supported"),
        (
            "layout(binding = 0, scalar) buffer A { uint a[]; }; layout(binding = 0, scalar) buffer B { uint b[]; };",
            "`a` and `b` share binding 0",
        ),
        ("layout(push_constant, scalar) uniform P { mat3 m; } p;", "TypeMatrix is not a type"),
    ] {
        match try_reflect(&format!("{declaration} {MAIN}")) {
            Ok(interface) => panic!("{declaration}: {interface:?}"),
            Err(error) => assert!(format!("{error:#}").contains(expected), "{declaration}: {error:#}"),
        }
    }
}
