//! A module that calls every function of a generated one by its number, with arguments and results
//! as words: what compares them with a GPU is written once.

use naga::{Function, Handle, ScalarKind, TypeInner};

use super::statements::turbofish;
use super::unit::{Unit, Written, name_of};

/// The generated functions of a shader that have arguments and a result.
pub fn functions_of<'m>(unit: &Unit<'m>) -> Vec<(Handle<Function>, &'m Function)> {
    let functions = unit.module.functions.iter();
    functions
        .filter(|(handle, function)| {
            let has_ends = function.result.is_some() && !function.arguments.is_empty();
            has_ends && unit.needs.contains_key(&handle.index())
        })
        .collect()
}

fn argument(unit: &Unit<'_>, inner: &TypeInner, next: &mut usize) -> Written<String> {
    let mut list = |n: u32, part: &TypeInner| -> Written<String> {
        let parts: Result<Vec<_>, _> = (0..n).map(|_| argument(unit, part, next)).collect();
        Ok(format!("[{}]", parts?.join(", ")))
    };
    match inner {
        TypeInner::Scalar(scalar) => {
            let word = format!("x[{next}]");
            *next += 1;
            Ok(match scalar.kind {
                ScalarKind::Float => format!("{word}.to_numbers()"),
                ScalarKind::Bool => format!("L::not({word}.eq(word::<L>(0)))"),
                _ => word,
            })
        }
        TypeInner::Vector { size, scalar } => list(*size as u32, &TypeInner::Scalar(*scalar)),
        TypeInner::Array { base, size, .. } => {
            let n = Unit::array_len(*size).ok_or("an argument without end")?;
            list(n, unit.inner(*base))
        }
        TypeInner::Struct { members, .. } => {
            let mut fields = Vec::new();
            for member in members {
                let name = name_of(member.name.as_deref().unwrap_or("unnamed"));
                let value = argument(unit, unit.inner(member.ty), next)?;
                fields.push(format!("{name}: {value}"));
            }
            let mut types = unit.module.types.iter();
            let name = types.find(|(_, ty)| ty.inner == *inner);
            let name = name.and_then(|(_, ty)| ty.name.clone());
            let name = name.ok_or("a struct without a name")?;
            Ok(format!("module::{name}::<L> {{ {} }}", fields.join(", ")))
        }
        _ => Err(format!("an argument of type {inner:?}").into()),
    }
}

fn results(unit: &Unit<'_>, inner: &TypeInner, path: &str, out: &mut Vec<String>) {
    match inner {
        TypeInner::Scalar(scalar) => out.push(match scalar.kind {
            ScalarKind::Float => format!("{path}.to_words()"),
            ScalarKind::Bool => format!("word_of::<L>({path})"),
            _ => path.to_owned(),
        }),
        TypeInner::Vector { size, scalar } => {
            for i in 0..*size as u32 {
                results(
                    unit,
                    &TypeInner::Scalar(*scalar),
                    &format!("{path}[{i}]"),
                    out,
                );
            }
        }
        TypeInner::Array { base, size, .. } => {
            for i in 0..Unit::array_len(*size).unwrap_or(0) {
                results(unit, unit.inner(*base), &format!("{path}[{i}]"), out);
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                let name = name_of(member.name.as_deref().unwrap_or("unnamed"));
                results(unit, unit.inner(member.ty), &format!("{path}.{name}"), out);
            }
        }
        _ => {}
    }
}

/// The module for the generated one at this path, for maps of this type. Every call is a function by
/// itself, because the compiler takes minutes for all in one; arrays run only what reads nothing.
pub fn calls(unit: &Unit<'_>, module: &str, maps: &str) -> Written<String> {
    let (mut structs, mut arms, mut pure_arms) = (String::new(), String::new(), String::new());
    let functions = functions_of(unit);
    for (number, (handle, function)) in functions.iter().enumerate() {
        let name = unit.function_name(*handle);
        let needs = unit.needs[&handle.index()];
        let mut texts = Vec::new();
        if needs.bound {
            texts.push("bound".to_owned());
        }
        if needs.lanes {
            texts.push("lanes".to_owned());
        }
        let mut next = 0;
        for argument_of in &function.arguments {
            texts.push(argument(unit, unit.inner(argument_of.ty), &mut next)?);
        }
        let mut words = Vec::new();
        if let Some(result) = &function.result {
            results(unit, unit.inner(result.ty), "r", &mut words);
        }
        structs += &format!(
            "\nstruct Call{number}<'a>(&'a Bound<'a, M>, &'a Eight<'a>);\n\n\
             impl LaneWork for Call{number}<'_> {{\n    type Out = Vec<[u32; 8]>;\n\n    \
             #[inline(always)]\n    fn run<L: Lanes>(self) -> Self::Out {{\n        \
             let (bound, (x, lanes)) = (self.0, self.1.load::<L>());\n        \
             let r = module::{name}{}({});\n        \
             store::<L>(&[{}])\n    }}\n}}\n",
            turbofish(needs),
            texts.join(", "),
            words.join(", ")
        );
        arms += &format!("        {number} => in_lanes(Call{number}(bound, eight)),\n");
        if !needs.bound {
            pure_arms += &format!("        {number} => in_arrays(Call{number}(bound, eight)),\n");
        }
    }
    Ok(format!(
        "//! Generated by the test `lanes`: calls the functions of `{module}` by number.\n\n\
         use {module}::{{self as module, Bound}};\n\
         use sensor_core::vector_lanes::{{LaneWork, Lanes, WordLanes, in_arrays, in_lanes}};\n\
         use sensor_shade::packing::{{word, word_of}};\n\n\
         use super::eight::{{Eight, store}};\n\n\
         type M = {maps};\n{structs}\n\
         pub fn call(number: usize, bound: &Bound<'_, M>, eight: &Eight<'_>) -> Vec<[u32; 8]> \
         {{\n    match number {{\n{arms}        \
         _ => panic!(\"there is no function {{number}}\"),\n    }}\n}}\n\n\
         /// With arrays, if the function reads nothing.\n\
         pub fn call_in_arrays(number: usize, bound: &Bound<'_, M>, eight: &Eight<'_>) -> \
         Option<Vec<[u32; 8]>> {{\n    Some(match number {{\n{pure_arms}        \
         _ => return None,\n    }})\n}}\n"
    ))
}
