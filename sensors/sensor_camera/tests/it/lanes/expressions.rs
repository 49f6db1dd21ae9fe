//! Expressions of a function in Rust.

use std::collections::{BTreeMap, BTreeSet};

use naga::valid::FunctionInfo;
use naga::{
    AddressSpace, BinaryOperator as Op, Expression, Function, GlobalVariable, Handle, Literal,
    LocalVariable, MathFunction as Math, Module, SampleLevel, ScalarKind, TypeInner, UnaryOperator,
};

use super::unit::{Unit, Written, name_of};

/// Where a pointer leads.
#[derive(Clone)]
enum Place {
    /// A variable of the function, or a part of it.
    Local(String),
    /// Words of a uniform or list: `further` behind the place that lanes give, if they do, which is
    /// at most `most` unless the list has no end.
    Memory {
        global: Handle<GlobalVariable>,
        lanes: Option<String>,
        most: Option<u32>,
        further: u32,
    },
}

/// Writes a function's expressions, with a `let` for each that is used more than once or that
/// depends on when it runs.
pub struct Expressions<'u, 'm> {
    pub unit: &'u mut Unit<'m>,
    pub function: &'m Function,
    info: &'m FunctionInfo,
    pub out: String,
    pub indent: usize,
    names: BTreeSet<String>,
    /// Names of expressions that have a `let`, in the blocks that are open.
    pub known: BTreeMap<Handle<Expression>, String>,
    pub locals: BTreeMap<Handle<LocalVariable>, String>,
    pub arguments: Vec<String>,
}

/// The text of a scalar that is the same in every lane and known before they run: literals and
/// overrides. Branches on it are those of Rust.
pub fn uniform(
    module: &Module,
    function: &Function,
    expression: Handle<Expression>,
) -> Option<String> {
    match &function.expressions[expression] {
        Expression::Literal(Literal::Bool(value)) => Some(value.to_string()),
        Expression::Override(handle) => {
            let name = module.overrides[*handle].name.as_deref()?;
            Some(format!("bound.overrides.{}", name.to_lowercase()))
        }
        Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr,
        } => Some(format!("!{}", uniform(module, function, *expr)?)),
        Expression::Binary { op, left, right } => {
            let op = match op {
                Op::LogicalAnd => "&&",
                Op::LogicalOr => "||",
                _ => return None,
            };
            let left = uniform(module, function, *left)?;
            let right = uniform(module, function, *right)?;
            Some(format!("({left} {op} {right})"))
        }
        _ => None,
    }
}

fn is_name(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes.all(|b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'.' | b'[' | b']'))
}

impl<'u, 'm> Expressions<'u, 'm> {
    pub fn new(unit: &'u mut Unit<'m>, function: &'m Function, info: &'m FunctionInfo) -> Self {
        let module = unit.module;
        let mut names: BTreeSet<String> = ["bound", "lanes", "result", "done"]
            .map(str::to_owned)
            .into();
        // A `let` of this name would hide the function.
        names.extend(module.functions.iter().filter_map(|(_, f)| f.name.clone()));
        let helpers = [
            "each2",
            "each3",
            "each4",
            "zip2",
            "zip3",
            "zip4",
            "dot",
            "cross",
            "length",
            "normalize",
            "reflect",
            "saturate",
            "fract",
            "mix",
            "smoothstep",
            "exp",
            "exp2",
            "log2",
            "pow",
            "sin",
            "cos",
            "atan2",
            "word",
            "number",
            "divided",
            "remainder",
        ];
        names.extend(helpers.map(str::to_owned));
        Expressions {
            unit,
            function,
            info,
            out: String::new(),
            indent: 1,
            names,
            known: BTreeMap::new(),
            locals: BTreeMap::new(),
            arguments: Vec::new(),
        }
    }

    pub fn line(&mut self, text: &str) {
        let indent = "    ".repeat(self.indent);
        self.out += &format!("{indent}{text}\n");
    }

    /// A name that nothing else in the function has.
    pub fn fresh(&mut self, wish: &str) -> String {
        let wish = name_of(wish);
        let mut name = wish.clone();
        let mut n = 1;
        while !self.names.insert(name.clone()) {
            n += 1;
            name = format!("{wish}_{n}");
        }
        name
    }

    pub fn inner(&self, expression: Handle<Expression>) -> &'m TypeInner {
        let types = &self.unit.module.types;
        self.info[expression].ty.inner_with(types)
    }

    fn scalar_kind(&self, expression: Handle<Expression>) -> Written<ScalarKind> {
        let scalar = self.inner(expression).scalar();
        Ok(scalar.ok_or("a scalar or vector is expected")?.kind)
    }

    /// How many components it has; `None` for a scalar.
    fn size(&self, expression: Handle<Expression>) -> Option<u32> {
        match self.inner(expression) {
            TypeInner::Vector { size, .. } => Some(*size as u32),
            _ => None,
        }
    }

    fn is_pointer(&self, expression: Handle<Expression>) -> bool {
        matches!(
            self.inner(expression),
            TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. }
        )
    }

    pub fn uniform(&self, expression: Handle<Expression>) -> Option<String> {
        uniform(self.unit.module, self.function, expression)
    }

    /// Writes what is evaluated here.
    pub fn emit(&mut self, range: &naga::Range<Expression>) -> Written<()> {
        for expression in range.clone() {
            if self.is_pointer(expression) || self.uniform(expression).is_some() {
                continue;
            }
            let n_uses = self.info[expression].ref_count;
            let given = self.function.named_expressions.get(&expression);
            let runs_here = match &self.function.expressions[expression] {
                Expression::Load { pointer } => {
                    let place = self.place(*pointer)?;
                    matches!(
                        place,
                        Place::Local(_) | Place::Memory { lanes: Some(_), .. }
                    )
                }
                Expression::ImageSample { .. } | Expression::ImageLoad { .. } => true,
                _ => false,
            };
            if runs_here || n_uses > 1 || given.is_some() {
                let value = self.value(expression)?;
                let name = self.fresh(given.map_or("t", String::as_str));
                self.line(&format!("let {name} = {value};"));
                self.known.insert(expression, name);
            }
        }
        Ok(())
    }

    /// The text of a value that is cheap to repeat.
    pub fn atom(&mut self, expression: Handle<Expression>) -> Written<String> {
        let value = self.value(expression)?;
        if is_name(&value) {
            return Ok(value);
        }
        let name = self.fresh("t");
        self.line(&format!("let {name} = {value};"));
        self.known.insert(expression, name.clone());
        Ok(name)
    }

    fn literal(literal: &Literal) -> Written<String> {
        Ok(match literal {
            Literal::F32(x) => format!("L::splat({x:?})"),
            Literal::U32(x) => format!("word::<L>({x})"),
            Literal::I32(x) => format!("word::<L>({x}i32 as u32)"),
            Literal::Bool(x) => format!("L::mask({x})"),
            _ => return Err(format!("the literal {literal:?} has no lanes").into()),
        })
    }

    /// A constant of the module.
    fn constant(&mut self, expression: Handle<Expression>) -> Written<String> {
        let module = self.unit.module;
        match &module.global_expressions[expression] {
            Expression::Literal(literal) => Self::literal(literal),
            Expression::Constant(handle) => self.constant(module.constants[*handle].init),
            Expression::ZeroValue(ty) => self.unit.zero(self.unit.inner(*ty)),
            Expression::Compose { components, .. } => {
                let parts: Result<Vec<_>, _> =
                    components.iter().map(|part| self.constant(*part)).collect();
                Ok(format!("[{}]", parts?.join(", ")))
            }
            Expression::Splat { size, value } => {
                Ok(format!("[{}; {}]", self.constant(*value)?, *size as u8))
            }
            other => Err(format!("a constant of {other:?}").into()),
        }
    }

    fn whole_constant(&self, expression: Handle<Expression>) -> Option<u32> {
        let module = self.unit.module;
        let literal = match &self.function.expressions[expression] {
            Expression::Literal(literal) => literal,
            Expression::Splat { value, .. } => return self.whole_constant(*value),
            Expression::Constant(handle) => {
                match &module.global_expressions[module.constants[*handle].init] {
                    Expression::Literal(literal) => literal,
                    _ => return None,
                }
            }
            _ => return None,
        };
        match literal {
            Literal::U32(x) => Some(*x),
            Literal::I32(x) => u32::try_from(*x).ok(),
            _ => None,
        }
    }

    /// The type that a pointer leads to, if it is not a component of a vector.
    fn pointee(&self, pointer: Handle<Expression>) -> Written<&'m TypeInner> {
        match self.inner(pointer) {
            TypeInner::Pointer { base, .. } => Ok(self.unit.inner(*base)),
            other => Err(format!("a part of {other:?} is no place").into()),
        }
    }

    fn place(&mut self, pointer: Handle<Expression>) -> Written<Place> {
        match self.function.expressions[pointer] {
            Expression::LocalVariable(local) => Ok(Place::Local(self.locals[&local].clone())),
            Expression::GlobalVariable(global) => {
                let variable = &self.unit.module.global_variables[global];
                match variable.space {
                    AddressSpace::Uniform | AddressSpace::Storage { .. } => Ok(Place::Memory {
                        global,
                        lanes: None,
                        most: Some(0),
                        further: 0,
                    }),
                    space => Err(format!(
                        "{}: variables of {space:?} have no lanes",
                        self.unit.global_name(global)
                    )
                    .into()),
                }
            }
            Expression::AccessIndex { base, index } => self.part(base, Ok(index)),
            Expression::Access { base, index } => match self.whole_constant(index) {
                Some(index) => self.part(base, Ok(index)),
                None => self.part(base, Err(index)),
            },
            ref other => Err(format!("a pointer from {other:?}").into()),
        }
    }

    /// A part of what `base` points to, by a number or by lanes.
    fn part(
        &mut self,
        base: Handle<Expression>,
        index: Result<u32, Handle<Expression>>,
    ) -> Written<Place> {
        let of = self.pointee(base)?;
        let place = self.place(base)?;
        match (place, of, index) {
            (Place::Local(path), TypeInner::Struct { members, .. }, Ok(index)) => {
                let name = members[index as usize].name.as_deref();
                Ok(Place::Local(format!(
                    "{path}.{}",
                    name_of(name.unwrap_or("unnamed"))
                )))
            }
            (Place::Local(path), _, Ok(index)) => Ok(Place::Local(format!("{path}[{index}]"))),
            (Place::Local(_), _, Err(_)) => Err("a variable cannot be indexed by lanes".into()),
            (
                Place::Memory {
                    global,
                    lanes,
                    most,
                    further,
                },
                of,
                index,
            ) => {
                let stride = match of {
                    TypeInner::Struct { members, .. } => {
                        let index = index.map_err(|_| "a struct is indexed by lanes")?;
                        let further = further + members[index as usize].offset / 4;
                        return Ok(Place::Memory {
                            global,
                            lanes,
                            most,
                            further,
                        });
                    }
                    TypeInner::Array { stride, .. } => stride / 4,
                    TypeInner::Vector { .. } => 1,
                    _ => return Err(format!("a part of {of:?} in memory").into()),
                };
                let n = match of {
                    TypeInner::Array { size, .. } => Unit::array_len(*size),
                    TypeInner::Vector { size, .. } => Some(*size as u32),
                    _ => None,
                };
                let (added, further) = match (index, n) {
                    (Ok(index), Some(_)) => (None, further + index * stride),
                    // A list without end may be shorter than this.
                    (Ok(index), None) => (Some(format!("word::<L>({})", index * stride)), further),
                    (Err(index), n) => {
                        let mut text = self.value(index)?;
                        if let Some(n) = n {
                            text += &format!(".min_unsigned(word::<L>({}))", n - 1);
                        }
                        if stride != 1 {
                            text += &format!(".mul(word::<L>({stride}))");
                        }
                        (Some(text), further)
                    }
                };
                let most = match (&added, n) {
                    (None, _) => most,
                    (Some(_), Some(n)) => most.map(|most| most + (n - 1) * stride),
                    (Some(_), None) => None,
                };
                let lanes = match (lanes, added) {
                    (Some(a), Some(b)) => Some(format!("{a}.add({b})")),
                    (a, b) => a.or(b),
                };
                Ok(Place::Memory {
                    global,
                    lanes,
                    most,
                    further,
                })
            }
        }
    }

    /// Words of memory as a value.
    fn read(
        &mut self,
        memory: &str,
        lanes: Option<&str>,
        further: u32,
        inner: &TypeInner,
    ) -> Written<String> {
        match inner {
            TypeInner::Scalar(scalar) => {
                let is_number = match scalar.kind {
                    ScalarKind::Float => true,
                    ScalarKind::Uint | ScalarKind::Sint => false,
                    kind => return Err(format!("{kind:?} in memory").into()),
                };
                Ok(match (lanes, is_number) {
                    (None, true) => format!("number::<L>({memory}[{further}])"),
                    (None, false) => format!("word::<L>({memory}[{further}])"),
                    (Some(at), true) => format!("numbers_at::<L>({memory}, {at}, {further})"),
                    (Some(at), false) => format!("words_at::<L>({memory}, {at}, {further})"),
                })
            }
            TypeInner::Vector { size, scalar } => {
                let part = TypeInner::Scalar(*scalar);
                let parts: Result<Vec<_>, _> = (0..*size as u32)
                    .map(|i| self.read(memory, lanes, further + i, &part))
                    .collect();
                Ok(format!("[{}]", parts?.join(", ")))
            }
            TypeInner::Array { base, size, stride } => {
                let n = Unit::array_len(*size).ok_or("a list without end as a value")?;
                let part = self.unit.inner(*base);
                let parts: Result<Vec<_>, _> = (0..n)
                    .map(|i| self.read(memory, lanes, further + i * stride / 4, part))
                    .collect();
                Ok(format!("[{}]", parts?.join(", ")))
            }
            TypeInner::Struct { members, .. } => {
                let mut fields = Vec::new();
                for member in members {
                    let part = self.unit.inner(member.ty);
                    let value = self.read(memory, lanes, further + member.offset / 4, part)?;
                    let name = name_of(member.name.as_deref().unwrap_or("unnamed"));
                    fields.push(format!("{name}: {value}"));
                }
                let name = self.unit.struct_name(inner)?;
                Ok(format!("{name}::<L> {{ {} }}", fields.join(", ")))
            }
            _ => Err(format!("{inner:?} in memory").into()),
        }
    }

    fn load(
        &mut self,
        expression: Handle<Expression>,
        pointer: Handle<Expression>,
    ) -> Written<String> {
        let inner = self.inner(expression);
        match self.place(pointer)? {
            Place::Local(path) => Ok(path),
            Place::Memory {
                global,
                lanes,
                most,
                further,
            } => {
                let n_words = inner.size(self.unit.module.to_ctx()) / 4;
                let end = most.map(|most| most + further + n_words);
                self.unit.note_memory(global, end)?;
                let memory = format!("bound.{}", self.unit.global_name(global));
                let lanes = lanes.map(|text| {
                    if is_name(&text) {
                        return text;
                    }
                    let name = self.fresh("at");
                    self.line(&format!("let {name} = {text};"));
                    name
                });
                self.read(&memory, lanes.as_deref(), further, inner)
            }
        }
    }

    /// The variable, or the part of one, that a store writes.
    pub fn target(&mut self, pointer: Handle<Expression>) -> Written<String> {
        match self.place(pointer)? {
            Place::Local(path) => Ok(path),
            Place::Memory { global, .. } => Err(format!(
                "{} is written: only variables are",
                self.unit.global_name(global)
            )
            .into()),
        }
    }

    /// The function of each component, of as many operands as there are; a scalar beside vectors
    /// counts for all components.
    fn by_component(
        &mut self,
        result: Handle<Expression>,
        operands: &[Handle<Expression>],
        f: impl Fn(&[String]) -> String,
    ) -> Written<String> {
        let Some(n) = self.size(result) else {
            let texts: Result<Vec<_>, _> = operands.iter().map(|e| self.value(*e)).collect();
            return Ok(f(&texts?));
        };
        let mut atoms = Vec::new();
        for operand in operands {
            atoms.push((self.atom(*operand)?, self.size(*operand).is_some()));
        }
        let parts: Vec<String> = (0..n)
            .map(|i| {
                let texts: Vec<String> = atoms
                    .iter()
                    .map(|(text, is_vector)| match is_vector {
                        true => format!("{text}[{i}]"),
                        false => text.clone(),
                    })
                    .collect();
                f(&texts)
            })
            .collect();
        Ok(format!("[{}]", parts.join(", ")))
    }

    /// A call of a helper whose arguments are whole vectors.
    fn whole(&mut self, name: &str, operands: &[Handle<Expression>]) -> Written<String> {
        let texts: Result<Vec<_>, _> = operands.iter().map(|e| self.value(*e)).collect();
        Ok(format!("{name}({})", texts?.join(", ")))
    }

    fn binary(
        &mut self,
        result: Handle<Expression>,
        op: Op,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Written<String> {
        let kind = self.scalar_kind(left)?;
        let both = |pattern: &'static str| {
            move |t: &[String]| pattern.replace("$a", &t[0]).replace("$b", &t[1])
        };
        let is_signed = kind == ScalarKind::Sint;
        let pattern = match (kind, op) {
            (ScalarKind::Bool, Op::LogicalAnd | Op::And) => "L::and($a, $b)",
            (ScalarKind::Bool, Op::LogicalOr | Op::InclusiveOr) => "L::or($a, $b)",
            (ScalarKind::Bool, _) => return Err(format!("{op:?} of booleans").into()),
            (_, Op::Add) => "$a.add($b)",
            (_, Op::Subtract) => "$a.sub($b)",
            (_, Op::Multiply) => "$a.mul($b)",
            (ScalarKind::Float, Op::Divide) => "$a.div($b)",
            (ScalarKind::Uint, Op::Divide) => match self.whole_constant(right) {
                Some(n) if n.is_power_of_two() => {
                    let by = n.trailing_zeros();
                    return self.by_component(result, &[left], |t| {
                        format!("{}.shr(word::<L>({by}))", t[0])
                    });
                }
                _ => "divided::<L>($a, $b)",
            },
            (ScalarKind::Uint, Op::Modulo) => "remainder::<L>($a, $b)",
            (_, Op::Equal) => "$a.eq($b)",
            (_, Op::NotEqual) => "L::not($a.eq($b))",
            (ScalarKind::Float, Op::Less) => "$a.lt($b)",
            (ScalarKind::Float, Op::LessEqual) => "$a.le($b)",
            (ScalarKind::Float, Op::Greater) => "$b.lt($a)",
            (ScalarKind::Float, Op::GreaterEqual) => "$b.le($a)",
            (_, Op::Less) if is_signed => "$a.lt_signed($b)",
            (_, Op::Greater) if is_signed => "$b.lt_signed($a)",
            (_, Op::LessEqual) if is_signed => "L::not($b.lt_signed($a))",
            (_, Op::GreaterEqual) if is_signed => "L::not($a.lt_signed($b))",
            (ScalarKind::Uint, Op::Less) => "$a.lt_unsigned($b)",
            (ScalarKind::Uint, Op::Greater) => "$b.lt_unsigned($a)",
            (ScalarKind::Uint, Op::LessEqual) => "L::not($b.lt_unsigned($a))",
            (ScalarKind::Uint, Op::GreaterEqual) => "L::not($a.lt_unsigned($b))",
            (_, Op::And) => "$a.and($b)",
            (_, Op::InclusiveOr) => "$a.or($b)",
            (_, Op::ExclusiveOr) => "$a.xor($b)",
            (_, Op::ShiftLeft) => "$a.shl($b)",
            (ScalarKind::Uint, Op::ShiftRight) => "$a.shr($b)",
            (ScalarKind::Sint, Op::ShiftRight) => "$a.shr_signed($b)",
            _ => return Err(format!("{op:?} of {kind:?}").into()),
        };
        self.by_component(result, &[left, right], both(pattern))
    }

    fn math(
        &mut self,
        result: Handle<Expression>,
        fun: Math,
        operands: &[Handle<Expression>],
    ) -> Written<String> {
        let kind = self.scalar_kind(operands[0])?;
        let pattern = match (fun, kind) {
            (Math::Dot, ScalarKind::Float) => return self.whole("dot", operands),
            (Math::Cross, _) => return self.whole("cross", operands),
            (Math::Length, _) if self.size(operands[0]).is_some() => {
                return self.whole("length", operands);
            }
            (Math::Normalize, _) => return self.whole("normalize", operands),
            (Math::Reflect, _) => return self.whole("reflect", operands),
            (Math::Pack4x8unorm, _) => return self.whole("pack_4x8_unorm::<L>", operands),
            (Math::Unpack4x8unorm, _) => return self.whole("unpack_4x8_unorm::<L>", operands),
            (Math::Unpack4x8snorm, _) => return self.whole("unpack_4x8_snorm::<L>", operands),
            (Math::Abs, ScalarKind::Float) => "$a.abs()",
            (Math::Abs, ScalarKind::Uint) => "$a",
            (Math::Min, ScalarKind::Float) => "$a.min($b)",
            (Math::Max, ScalarKind::Float) => "$a.max($b)",
            (Math::Clamp, ScalarKind::Float) => "$a.max($b).min($c)",
            (Math::Min, ScalarKind::Uint) => "$a.min_unsigned($b)",
            (Math::Max, ScalarKind::Uint) => "$a.max_unsigned($b)",
            (Math::Clamp, ScalarKind::Uint) => "$a.max_unsigned($b).min_unsigned($c)",
            (Math::Min, ScalarKind::Sint) => "$a.min_signed($b)",
            (Math::Max, ScalarKind::Sint) => "$a.max_signed($b)",
            (Math::Clamp, ScalarKind::Sint) => "$a.max_signed($b).min_signed($c)",
            (Math::Saturate, _) => "saturate($a)",
            (Math::Floor, _) => "$a.floor()",
            (Math::Fract, _) => "fract($a)",
            (Math::Sqrt, _) => "$a.sqrt()",
            (Math::InverseSqrt, _) => "inverse_sqrt($a)",
            (Math::Exp, _) => "exp($a)",
            (Math::Exp2, _) => "exp2($a)",
            (Math::Log2, _) => "log2($a)",
            (Math::Pow, _) => "pow($a, $b)",
            (Math::Sin, _) => "sin($a)",
            (Math::Cos, _) => "cos($a)",
            (Math::Atan2, _) => "atan2($a, $b)",
            (Math::Mix, _) => "mix($a, $b, $c)",
            (Math::SmoothStep, _) => "smoothstep($a, $b, $c)",
            (Math::FirstTrailingBit, _) => "first_trailing_bit::<L>($a)",
            _ => return Err(format!("the function {fun:?} of {kind:?} has no lanes").into()),
        };
        self.by_component(result, operands, |t| {
            let mut text = pattern.to_owned();
            for (name, value) in ["$a", "$b", "$c"].iter().zip(t) {
                text = text.replace(name, value);
            }
            text
        })
    }

    fn converted(
        &mut self,
        result: Handle<Expression>,
        expr: Handle<Expression>,
        to: ScalarKind,
        convert: bool,
    ) -> Written<String> {
        use ScalarKind::{Bool, Float, Sint, Uint};
        let from = self.scalar_kind(expr)?;
        let pattern = match (from, to, convert) {
            (Float, Float, _) | (Sint | Uint, Sint | Uint, _) | (Bool, Bool, _) => "$a",
            (Float, Sint | Uint, false) => "$a.to_words()",
            (Sint | Uint, Float, false) => "$a.to_numbers()",
            (Float, Sint, true) => "$a.to_signed()",
            (Float, Uint, true) => "$a.to_unsigned()",
            (Sint, Float, true) => "$a.from_signed()",
            (Uint, Float, true) => "$a.from_unsigned()",
            (Bool, Float, true) => "number_of::<L>($a)",
            (Bool, Sint | Uint, true) => "word_of::<L>($a)",
            _ => return Err(format!("{from:?} as {to:?}").into()),
        };
        self.by_component(result, &[expr], |t| pattern.replace("$a", &t[0]))
    }

    fn compose(
        &mut self,
        expression: Handle<Expression>,
        components: &[Handle<Expression>],
    ) -> Written<String> {
        match self.inner(expression) {
            inner @ TypeInner::Struct { members, .. } => {
                let mut fields = Vec::new();
                for (member, component) in members.iter().zip(components) {
                    let name = name_of(member.name.as_deref().unwrap_or("unnamed"));
                    fields.push(format!("{name}: {}", self.value(*component)?));
                }
                let name = self.unit.struct_name(inner)?;
                Ok(format!("{name}::<L> {{ {} }}", fields.join(", ")))
            }
            TypeInner::Vector { .. } => {
                let mut parts = Vec::new();
                for component in components {
                    match self.size(*component) {
                        Some(n) => {
                            let name = self.atom(*component)?;
                            parts.extend((0..n).map(|i| format!("{name}[{i}]")));
                        }
                        None => parts.push(self.value(*component)?),
                    }
                }
                Ok(format!("[{}]", parts.join(", ")))
            }
            _ => {
                let parts: Result<Vec<_>, _> =
                    components.iter().map(|part| self.value(*part)).collect();
                Ok(format!("[{}]", parts?.join(", ")))
            }
        }
    }

    fn image(&mut self, expression: Handle<Expression>) -> Written<String> {
        let (image, verb, inputs) = match &self.function.expressions[expression] {
            Expression::ImageSample {
                image,
                gather: None,
                coordinate,
                array_index: None,
                offset: None,
                level,
                depth_ref,
                clamp_to_edge: false,
                ..
            } => match (level, depth_ref) {
                (SampleLevel::Exact(level), None) => (
                    *image,
                    "sampled",
                    vec![("at", *coordinate), ("level", *level)],
                ),
                (SampleLevel::Zero, Some(depth)) => (
                    *image,
                    "compared",
                    vec![("at", *coordinate), ("depth", *depth)],
                ),
                _ => return Err("a sample without a level".into()),
            },
            Expression::ImageLoad {
                image,
                coordinate,
                array_index: None,
                sample: None,
                level: Some(level),
            } if self.whole_constant(*level) == Some(0) => {
                (*image, "loaded", vec![("at", *coordinate)])
            }
            other => return Err(format!("the image operation {other:?}").into()),
        };
        let Expression::GlobalVariable(image) = self.function.expressions[image] else {
            return Err("an image that is no variable".into());
        };
        let name = format!("{}_{verb}", self.unit.global_name(image));
        let (mut texts, mut parameters) = (Vec::new(), Vec::new());
        for (parameter, input) in inputs {
            let ty = self.inner(input);
            let ty = self.unit.rust_type(ty)?;
            parameters.push(format!("{parameter}: {ty}"));
            texts.push(self.value(input)?);
        }
        let result = self.inner(expression);
        let result = self.unit.rust_type(result)?;
        let signature = format!("(&self, {}) -> {result}", parameters.join(", "));
        self.unit.maps.insert(name.clone(), signature);
        Ok(format!("bound.maps.{name}({})", texts.join(", ")))
    }

    /// The text of a value.
    pub fn value(&mut self, expression: Handle<Expression>) -> Written<String> {
        if let Some(name) = self.known.get(&expression) {
            return Ok(name.clone());
        }
        if let Some(text) = self.uniform(expression) {
            return Ok(format!("L::mask({text})"));
        }
        let function = self.function;
        match &function.expressions[expression] {
            Expression::Literal(literal) => Self::literal(literal),
            Expression::Constant(handle) => {
                let init = self.unit.module.constants[*handle].init;
                self.constant(init)
            }
            Expression::Override(_) => Err("an override that is no boolean".into()),
            Expression::ZeroValue(ty) => self.unit.zero(self.unit.inner(*ty)),
            Expression::Compose { components, .. } => self.compose(expression, components),
            Expression::Access { base, index } => match self.whole_constant(*index) {
                Some(index) => Ok(format!("{}[{index}]", self.atom(*base)?)),
                None => Err("a value is indexed by lanes".into()),
            },
            Expression::AccessIndex { base, index } => {
                let of = self.inner(*base);
                let value = self.atom(*base)?;
                match of {
                    TypeInner::Struct { members, .. } => {
                        let name = members[*index as usize].name.as_deref();
                        Ok(format!("{value}.{}", name_of(name.unwrap_or("unnamed"))))
                    }
                    _ => Ok(format!("{value}[{index}]")),
                }
            }
            Expression::Splat { size, value } => {
                Ok(format!("[{}; {}]", self.value(*value)?, *size as u8))
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => {
                let vector = self.atom(*vector)?;
                let parts: Vec<String> = pattern[..*size as usize]
                    .iter()
                    .map(|part| format!("{vector}[{}]", *part as u8))
                    .collect();
                Ok(format!("[{}]", parts.join(", ")))
            }
            Expression::FunctionArgument(index) => Ok(self.arguments[*index as usize].clone()),
            Expression::Load { pointer } => self.load(expression, *pointer),
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => self.image(expression),
            Expression::Unary { op, expr } => {
                let kind = self.scalar_kind(*expr)?;
                let pattern = match (op, kind) {
                    (UnaryOperator::Negate, ScalarKind::Float) => "$a.neg()",
                    (UnaryOperator::Negate, _) => "word::<L>(0).sub($a)",
                    (UnaryOperator::LogicalNot, _) => "L::not($a)",
                    (UnaryOperator::BitwiseNot, _) => "$a.xor(word::<L>(u32::MAX))",
                };
                self.by_component(expression, &[*expr], |t| pattern.replace("$a", &t[0]))
            }
            Expression::Binary { op, left, right } => self.binary(expression, *op, *left, *right),
            Expression::Select {
                condition,
                accept,
                reject,
            } => {
                if let Some(text) = self.uniform(*condition) {
                    let (accept, reject) = (self.value(*accept)?, self.value(*reject)?);
                    return Ok(format!("(if {text} {{ {accept} }} else {{ {reject} }})"));
                }
                let kind = self.scalar_kind(*accept)?;
                let pattern = match kind {
                    ScalarKind::Float => "L::select($c, $a, $b)",
                    ScalarKind::Bool => "L::or(L::and($c, $a), L::and(L::not($c), $b))",
                    _ => "<L::Words>::select($c, $a, $b)",
                };
                self.by_component(expression, &[*accept, *reject, *condition], |t| {
                    let text = pattern.replace("$a", &t[0]).replace("$b", &t[1]);
                    text.replace("$c", &t[2])
                })
            }
            Expression::Relational { fun, argument } => {
                let n = self.size(*argument).ok_or("any or all of a scalar")?;
                let vector = self.atom(*argument)?;
                let join = match fun {
                    naga::RelationalFunction::All => "L::and",
                    naga::RelationalFunction::Any => "L::or",
                    other => return Err(format!("the relation {other:?}").into()),
                };
                Ok((1..n).fold(format!("{vector}[0]"), |text, i| {
                    format!("{join}({text}, {vector}[{i}])")
                }))
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                arg3,
            } => {
                let operands: Vec<_> = [Some(*arg), *arg1, *arg2, *arg3]
                    .into_iter()
                    .flatten()
                    .collect();
                self.math(expression, *fun, &operands)
            }
            Expression::As {
                expr,
                kind,
                convert,
            } => self.converted(expression, *expr, *kind, convert.is_some()),
            Expression::ArrayLength(list) => {
                let Place::Memory {
                    global,
                    lanes: None,
                    most: _,
                    further: 0,
                } = self.place(*list)?
                else {
                    return Err("the length of a part of a list".into());
                };
                self.unit.note_memory(global, None)?;
                let ty = self.unit.module.global_variables[global].ty;
                let TypeInner::Array { stride, .. } = self.unit.inner(ty) else {
                    return Err("the length of what is no list".into());
                };
                let name = self.unit.global_name(global);
                Ok(format!(
                    "word::<L>((bound.{name}.len() / {}) as u32)",
                    stride / 4
                ))
            }
            other => Err(format!("the expression {other:?} has no lanes").into()),
        }
    }
}
