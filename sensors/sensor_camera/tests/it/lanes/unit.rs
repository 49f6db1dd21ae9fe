//! A shader as the generator sees it: its types in Rust, and what is collected on the way.

use std::collections::{BTreeMap, BTreeSet};

use naga::valid::ModuleInfo;
use naga::{
    ArraySize, Function, GlobalVariable, Handle, Module, Scalar, ScalarKind, Type, TypeInner,
};

/// Why a part of a shader cannot be written over lanes.
#[derive(Debug)]
pub struct Unwritten(String);

/// What was written, if lanes can do it.
pub type Written<T> = Result<T, Unwritten>;

impl From<String> for Unwritten {
    fn from(why: String) -> Self {
        Unwritten(why)
    }
}

impl From<&str> for Unwritten {
    fn from(why: &str) -> Self {
        Unwritten(why.to_owned())
    }
}

impl std::fmt::Display for Unwritten {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// What a function takes beside its own arguments.
#[derive(Clone, Copy, Default)]
pub struct Needs {
    /// Overrides, uniforms, lists or images.
    pub bound: bool,
    /// The lanes that it runs for.
    pub lanes: bool,
}

/// A shader, and what its functions turned out to use.
pub struct Unit<'m> {
    pub module: &'m Module,
    pub info: &'m ModuleInfo,
    pub needs: BTreeMap<usize, Needs>,
    /// Structs that are values.
    pub structs: BTreeSet<Handle<Type>>,
    /// Words of each uniform or list that are read: up to which one, or `None` for a list without
    /// end.
    pub memory: BTreeMap<Handle<GlobalVariable>, Option<u32>>,
    /// Functions that read images: name to the rest of the signature.
    pub maps: BTreeMap<String, String>,
}

/// Words that Rust or the generated code has taken.
const TAKEN: [&str; 34] = [
    "abstract", "as", "async", "await", "become", "box", "crate", "do", "dyn", "enum", "extern",
    "final", "gen", "impl", "in", "macro", "mod", "move", "mut", "priv", "pub", "ref", "self",
    "static", "super", "trait", "try", "type", "typeof", "unsized", "use", "virtual", "where",
    "yield",
];

/// A name of WGSL as one of Rust.
pub fn name_of(wgsl: &str) -> String {
    if TAKEN.contains(&wgsl) {
        format!("{wgsl}_")
    } else {
        wgsl.to_owned()
    }
}

impl<'m> Unit<'m> {
    pub fn new(module: &'m Module, info: &'m ModuleInfo) -> Unit<'m> {
        Unit {
            module,
            info,
            needs: BTreeMap::new(),
            structs: BTreeSet::new(),
            memory: BTreeMap::new(),
            maps: BTreeMap::new(),
        }
    }

    pub fn inner(&self, ty: Handle<Type>) -> &'m TypeInner {
        &self.module.types[ty].inner
    }

    pub fn function_name(&self, function: Handle<Function>) -> String {
        let name = self.module.functions[function].name.as_deref();
        name_of(name.unwrap_or("unnamed"))
    }

    pub fn global_name(&self, global: Handle<GlobalVariable>) -> String {
        let name = self.module.global_variables[global].name.as_deref();
        name_of(name.unwrap_or("unnamed"))
    }

    fn struct_handle(&self, inner: &TypeInner) -> Option<Handle<Type>> {
        let mut types = self.module.types.iter();
        types
            .find(|(_, ty)| ty.inner == *inner)
            .map(|(handle, _)| handle)
    }

    /// The name of a struct, which is noted as used.
    pub fn struct_name(&mut self, inner: &TypeInner) -> Written<String> {
        let handle = self.struct_handle(inner).ok_or("a struct without a type")?;
        self.structs.insert(handle);
        let name = self.module.types[handle].name.clone();
        Ok(name.ok_or("a struct without a name")?)
    }

    pub fn scalar_type(scalar: Scalar) -> Written<&'static str> {
        match (scalar.kind, scalar.width) {
            (ScalarKind::Float, 4) => Ok("L"),
            (ScalarKind::Uint | ScalarKind::Sint, 4) => Ok("L::Words"),
            (ScalarKind::Bool, _) => Ok("L::Mask"),
            _ => Err(format!(
                "a scalar of {} bytes, {:?}: only f32, u32, i32 and bool have lanes",
                scalar.width, scalar.kind
            )
            .into()),
        }
    }

    pub fn array_len(size: ArraySize) -> Option<u32> {
        match size {
            ArraySize::Constant(n) => Some(n.get()),
            _ => None,
        }
    }

    /// The type of a value in Rust.
    pub fn rust_type(&mut self, inner: &TypeInner) -> Written<String> {
        match inner {
            TypeInner::Scalar(scalar) => Ok(Self::scalar_type(*scalar)?.to_owned()),
            TypeInner::Vector { size, scalar } => Ok(format!(
                "[{}; {}]",
                Self::scalar_type(*scalar)?,
                *size as u8
            )),
            TypeInner::Array { base, size, .. } => {
                let n = Self::array_len(*size).ok_or("an array without end as a value")?;
                let base = self.inner(*base);
                Ok(format!("[{}; {n}]", self.rust_type(base)?))
            }
            TypeInner::Struct { .. } => Ok(format!("{}<L>", self.struct_name(inner)?)),
            _ => Err(format!("a value of type {inner:?} has no lanes").into()),
        }
    }

    /// The zero of a type.
    pub fn zero(&mut self, inner: &TypeInner) -> Written<String> {
        match inner {
            TypeInner::Scalar(scalar) => Ok(match scalar.kind {
                ScalarKind::Float => "L::splat(0.0)",
                ScalarKind::Bool => "L::mask(false)",
                _ => "word::<L>(0)",
            }
            .to_owned()),
            TypeInner::Vector { size, scalar } => {
                let zero = self.zero(&TypeInner::Scalar(*scalar))?;
                Ok(format!("[{zero}; {}]", *size as u8))
            }
            TypeInner::Array { base, size, .. } => {
                let n = Self::array_len(*size).ok_or("an array without end as a value")?;
                let base = self.inner(*base);
                Ok(format!("[{}; {n}]", self.zero(base)?))
            }
            TypeInner::Struct { members, .. } => {
                let mut fields = Vec::new();
                for member in members {
                    let name = name_of(member.name.as_deref().unwrap_or("unnamed"));
                    let zero = self.zero(self.inner(member.ty))?;
                    fields.push(format!("{name}: {zero}"));
                }
                let name = self.struct_name(inner)?;
                Ok(format!("{name}::<L> {{ {} }}", fields.join(", ")))
            }
            _ => Err(format!("a value of type {inner:?} has no zero").into()),
        }
    }

    /// `a` in the lanes of the mask, else `b`, all of them names.
    pub fn blend(&mut self, inner: &TypeInner, mask: &str, a: &str, b: &str) -> Written<String> {
        let of_parts = |unit: &mut Self, n: u32, part: &TypeInner| {
            if !(2..=4).contains(&n) {
                return Err(format!("an array of {n} as a variable: 2 to 4 have lanes").into());
            }
            let part = unit.blend(part, mask, "a", "b")?;
            Ok(format!("zip{n}({a}, {b}, |a, b| {part})"))
        };
        match inner {
            TypeInner::Scalar(scalar) => Ok(match scalar.kind {
                ScalarKind::Float => format!("L::select({mask}, {a}, {b})"),
                ScalarKind::Bool => {
                    format!("L::or(L::and({mask}, {a}), L::and(L::not({mask}), {b}))")
                }
                _ => format!("<L::Words>::select({mask}, {a}, {b})"),
            }),
            TypeInner::Vector { size, scalar } => {
                of_parts(self, *size as u32, &TypeInner::Scalar(*scalar))
            }
            TypeInner::Array { base, size, .. } => {
                let n = Self::array_len(*size).ok_or("an array without end as a value")?;
                let part = self.inner(*base);
                of_parts(self, n, part)
            }
            TypeInner::Struct { .. } => {
                let name = self.struct_name(inner)?;
                Ok(format!("{name}::<L>::blend({mask}, {a}, {b})"))
            }
            _ => Err(format!("a value of type {inner:?} cannot be blended").into()),
        }
    }

    /// Notes that words of a uniform or list are read, up to before `end` or, if the place is not
    /// known, all.
    pub fn note_memory(&mut self, global: Handle<GlobalVariable>, end: Option<u32>) -> Written<()> {
        let ty = self.module.global_variables[global].ty;
        let size = match self.inner(ty) {
            TypeInner::Array { size, stride, .. } => {
                let Some(n) = Self::array_len(*size) else {
                    self.memory.insert(global, None);
                    return Ok(());
                };
                match end {
                    Some(end) => end.next_multiple_of(stride / 4),
                    None => n * stride / 4,
                }
            }
            inner => inner.size(self.module.to_ctx()) / 4,
        };
        let known = self.memory.entry(global).or_insert(Some(0));
        *known = known.map(|known| known.max(size));
        Ok(())
    }
}
