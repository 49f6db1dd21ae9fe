//! Rust over lanes from the WGSL of a shader: structs, what is bound, and every function.

use std::collections::BTreeSet;

use naga::{AddressSpace, Block, Module, Statement, TypeInner};

use super::statements::function_text;
use super::unit::{Unit, Written, name_of};

const HEAD: &str = "\
//! Generated from WGSL by the test `lanes` of `sensor_camera`; `./gantry bless` writes it anew.
";

/// What generated functions call; `$` is the path of `sensor_shade`.
const USES: &str = "
use sensor_core::vector_lanes::{Lanes, WordLanes};

use $::functions::{atan2, cos, exp, exp2, fract, inverse_sqrt, log2, mix, pow, saturate, sin, smoothstep};
use $::memory::{number, numbers_at, words_at};
use $::packing::{divided, first_trailing_bit, number_of, pack_4x8_unorm, remainder, unpack_4x8_snorm, unpack_4x8_unorm, word, word_of};
use $::vectors::{cross, dot, length, normalize, reflect, zip2, zip3, zip4};
";

/// These functions and all that they call.
fn reached(module: &Module, roots: &[&str]) -> Written<BTreeSet<usize>> {
    let mut found = BTreeSet::new();
    for root in roots {
        let mut functions = module.functions.iter();
        let of_name = functions.find(|(_, function)| function.name.as_deref() == Some(*root));
        let (handle, _) = of_name.ok_or(format!("there is no function {root}"))?;
        found.insert(handle.index());
    }
    // Who calls stands behind what it calls.
    for (handle, function) in module.functions.iter().rev() {
        if found.contains(&handle.index()) {
            callees(&function.body, &mut found);
        }
    }
    Ok(found)
}

fn callees(block: &Block, found: &mut BTreeSet<usize>) {
    for statement in block.iter() {
        match statement {
            Statement::Call { function, .. } => {
                found.insert(function.index());
            }
            Statement::Block(block) => callees(block, found),
            Statement::If { accept, reject, .. } => {
                callees(accept, found);
                callees(reject, found);
            }
            Statement::Loop {
                body, continuing, ..
            } => {
                callees(body, found);
                callees(continuing, found);
            }
            _ => {}
        }
    }
}

/// Generates the module of these functions and all that they call, for which `shade` is the path of
/// `sensor_shade`.
pub fn generated(unit: &mut Unit<'_>, roots: &[&str], shade: &str) -> Written<String> {
    let module = unit.module;
    let reached = reached(module, roots)?;
    let mut functions = String::new();
    for (handle, _) in module.functions.iter() {
        if !reached.contains(&handle.index()) {
            continue;
        }
        functions += "\n";
        functions += &function_text(unit, handle)?;
    }
    // Structs in structs become known while these are written.
    let mut structs = String::new();
    for (handle, ty) in module.types.iter() {
        if let TypeInner::Struct { members, .. } = &ty.inner
            && unit.structs.contains(&handle)
        {
            let name = ty.name.as_deref().ok_or("a struct without a name")?;
            let (mut fields, mut blended) = (String::new(), String::new());
            for member in members {
                let field = name_of(member.name.as_deref().unwrap_or("unnamed"));
                let inner = unit.inner(member.ty);
                let rust = unit.rust_type(inner)?;
                fields += &format!("    pub {field}: {rust},\n");
                let [a, b] = ["a", "b"].map(|of| format!("{of}.{field}"));
                let blend = unit.blend(inner, "lanes", &a, &b)?;
                blended += &format!("            {field}: {blend},\n");
            }
            structs += &format!(
                "\n#[derive(Clone, Copy)]\npub struct {name}<L: Lanes> {{\n{fields}}}\n\n\
                 impl<L: Lanes> {name}<L> {{\n    #[inline(always)]\n    \
                 pub fn blend(lanes: L::Mask, a: Self, b: Self) -> Self {{\n        \
                 {name} {{\n{blended}        }}\n    }}\n}}\n"
            );
        }
    }
    Ok(format!(
        "{HEAD}{}{}{}{}{structs}{functions}",
        USES.replace('$', shade),
        overrides(unit)?,
        bound(unit)?,
        maps(unit)
    ))
}

fn overrides(unit: &Unit<'_>) -> Written<String> {
    let (mut fields, mut defaults) = (String::new(), String::new());
    for (_, of) in unit.module.overrides.iter() {
        let name = of.name.as_deref().ok_or("an override without a name")?;
        let name = name.to_lowercase();
        let init = of.init.map(|init| &unit.module.global_expressions[init]);
        let Some(naga::Expression::Literal(naga::Literal::Bool(init))) = init else {
            return Err(format!("the override {name} is no boolean with a value").into());
        };
        fields += &format!("    pub {name}: bool,\n");
        defaults += &format!("            {name}: {init},\n");
    }
    Ok(format!(
        "\n/// What a pipeline chooses.\n#[derive(Clone, Copy, Debug)]\n\
         pub struct Overrides {{\n{fields}}}\n\nimpl Default for Overrides {{\n    \
         #[inline(always)]\n    fn default() -> Self {{\n        \
         Overrides {{\n{defaults}        }}\n    }}\n}}\n"
    ))
}

/// Uniforms and lists, as many words of each as are read.
fn bound(unit: &Unit<'_>) -> Written<String> {
    let mut fields = String::new();
    for (handle, variable) in unit.module.global_variables.iter() {
        let is_memory = matches!(
            variable.space,
            AddressSpace::Uniform | AddressSpace::Storage { .. }
        );
        if let (true, Some(n_words)) = (is_memory, unit.memory.get(&handle)) {
            let ty = match n_words {
                Some(n) => format!("[u32; {n}]"),
                None => "[u32]".to_owned(),
            };
            fields += &format!("    pub {}: &'a {ty},\n", unit.global_name(handle));
        }
    }
    Ok(format!(
        "\n/// What a pipeline's bind groups hold, and its overrides.\n#[derive(Clone, Copy)]\n\
         pub struct Bound<'a, M> {{\n    pub overrides: Overrides,\n{fields}    \
         pub maps: &'a M,\n}}\n"
    ))
}

fn maps(unit: &Unit<'_>) -> String {
    let methods: String = unit
        .maps
        .iter()
        .map(|(name, signature)| format!("    fn {name}{signature};\n"))
        .collect();
    format!(
        "\n/// The images that the shaders read, and how. Lanes that do not run may ask for any \
         place.\npub trait Maps<L: Lanes> {{\n{methods}}}\n"
    )
}
