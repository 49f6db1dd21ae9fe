//! Statements of a function in Rust: branches and loops run for the lanes of a mask.

use naga::{Block, Expression, Function, Handle, Literal, Statement, TypeInner};

use super::expressions::{Expressions, uniform};
use super::unit::{Needs, Unit, Written};

/// A loop that is open.
struct OpenLoop {
    /// Lanes that have not left it.
    on: String,
    /// Lanes that go on with the next round.
    next: Option<String>,
}

struct Statements<'u, 'm> {
    text: Expressions<'u, 'm>,
    result: Option<&'m TypeInner>,
    /// Whether some lanes return while others go on.
    returns_by_lane: bool,
    needs: Needs,
    loops: Vec<OpenLoop>,
    /// How many branches and loops that lanes take or leave by themselves are open.
    depth: usize,
}

/// What a statement makes lanes leave.
#[derive(Clone, Copy, Default)]
struct Leaves {
    function: bool,
    round: bool,
}

impl Leaves {
    fn or(self, other: Leaves) -> Leaves {
        Leaves {
            function: self.function || other.function,
            round: self.round || other.round,
        }
    }

    fn any(self) -> bool {
        self.function || self.round
    }
}

fn leaves_of(unit: &Unit<'_>, function: &Function, block: &Block, by_lane: bool) -> Leaves {
    block.iter().fold(Leaves::default(), |found, statement| {
        found.or(leaves(unit, function, statement, by_lane))
    })
}

/// What a statement makes lanes leave while others go on; `by_lane` is whether only some run it.
fn leaves(unit: &Unit<'_>, function: &Function, statement: &Statement, by_lane: bool) -> Leaves {
    let of = |block: &Block, by_lane| leaves_of(unit, function, block, by_lane);
    match statement {
        Statement::Return { .. } => Leaves {
            function: by_lane,
            round: false,
        },
        Statement::Break | Statement::Continue => Leaves {
            function: false,
            round: true,
        },
        Statement::If {
            condition,
            accept,
            reject,
        } => {
            let by_lane = by_lane || uniform(unit.module, function, *condition).is_none();
            of(accept, by_lane).or(of(reject, by_lane))
        }
        Statement::Loop {
            body, continuing, ..
        } => Leaves {
            function: of(body, true).or(of(continuing, true)).function,
            round: false,
        },
        Statement::Block(block) => of(block, by_lane),
        _ => Leaves::default(),
    }
}

/// Whether a loop's body goes on with the next round before its end.
fn continues(block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Continue => true,
        Statement::If { accept, reject, .. } => continues(accept) || continues(reject),
        Statement::Block(block) => continues(block),
        _ => false,
    })
}

/// What a function takes beside its arguments; those that it calls were looked at before.
pub fn needs_of(unit: &Unit<'_>, function: &Function) -> Needs {
    let mut needs = Needs::default();
    for (_, expression) in function.expressions.iter() {
        needs.bound |= matches!(
            expression,
            Expression::GlobalVariable(_) | Expression::Override(_)
        );
    }
    fn walk(unit: &Unit<'_>, function: &Function, block: &Block, needs: &mut Needs) {
        for statement in block.iter() {
            match statement {
                Statement::If {
                    condition,
                    accept,
                    reject,
                } => {
                    needs.lanes |= uniform(unit.module, function, *condition).is_none();
                    walk(unit, function, accept, needs);
                    walk(unit, function, reject, needs);
                }
                Statement::Loop {
                    body, continuing, ..
                } => {
                    needs.lanes = true;
                    walk(unit, function, body, needs);
                    walk(unit, function, continuing, needs);
                }
                Statement::Block(block) => walk(unit, function, block, needs),
                Statement::Call { function, .. } => {
                    let callee = unit.needs.get(&function.index());
                    let callee = callee.copied().unwrap_or_default();
                    needs.bound |= callee.bound;
                    needs.lanes |= callee.lanes;
                }
                _ => {}
            }
        }
    }
    walk(unit, function, &function.body, &mut needs);
    needs
}

/// The generic parameters that a call of a function gives.
pub fn turbofish(needs: Needs) -> &'static str {
    if needs.bound { "::<L, M>" } else { "::<L>" }
}

/// A function in Rust.
pub fn function_text<'m>(unit: &mut Unit<'m>, handle: Handle<Function>) -> Written<String> {
    let module = unit.module;
    let info = unit.info;
    let function = &module.functions[handle];
    let name = unit.function_name(handle);
    let needs = needs_of(unit, function);
    unit.needs.insert(handle.index(), needs);
    let returns_by_lane = leaves_of(unit, function, &function.body, false).function;
    let result = function.result.as_ref().map(|result| unit.inner(result.ty));
    let statements = Statements {
        text: Expressions::new(unit, function, &info[handle]),
        result,
        returns_by_lane,
        needs,
        loops: Vec::new(),
        depth: 0,
    };
    statements
        .function(&name, function)
        .map_err(|error| format!("function {name}: {error}").into())
}

impl<'u, 'm> Statements<'u, 'm> {
    fn function(mut self, name: &str, function: &'m Function) -> Written<String> {
        let mut parameters = Vec::new();
        if self.needs.bound {
            parameters.push("bound: &Bound<'_, M>".to_owned());
        }
        if self.needs.lanes {
            parameters.push("lanes: L::Mask".to_owned());
        }
        for argument in &function.arguments {
            let inner = self.text.unit.inner(argument.ty);
            let ty = self.text.unit.rust_type(inner)?;
            let name = self
                .text
                .fresh(argument.name.as_deref().unwrap_or("unnamed"));
            parameters.push(format!("{name}: {ty}"));
            self.text.arguments.push(name);
        }
        let generics = if self.needs.bound {
            "<L: Lanes, M: Maps<L>>"
        } else {
            "<L: Lanes>"
        };
        let returned = match self.result {
            Some(inner) => format!(" -> {}", self.text.unit.rust_type(inner)?),
            None => String::new(),
        };
        let head = format!(
            "#[inline(always)]\npub fn {name}{generics}({}){returned} {{\n",
            parameters.join(", ")
        );
        if self.returns_by_lane {
            let inner = self.result.ok_or("some lanes return nothing")?;
            let zero = self.text.unit.zero(inner)?;
            self.text.line(&format!("let mut result = {zero};"));
            self.text.line("let mut done = L::mask(false);");
        }
        for (local, variable) in function.local_variables.iter() {
            let inner = self.text.unit.inner(variable.ty);
            let init = match variable.init {
                Some(init) => self.text.value(init)?,
                None => self.text.unit.zero(inner)?,
            };
            let ty = self.text.unit.rust_type(inner)?;
            let name = self.text.fresh(variable.name.as_deref().unwrap_or("v"));
            self.text.line(&format!("let mut {name}: {ty} = {init};"));
            self.text.locals.insert(local, name);
        }
        self.block(&function.body, "lanes")?;
        if self.returns_by_lane {
            self.text.line("result");
        }
        Ok(format!("{head}{}}}\n", self.text.out))
    }

    /// Statements between braces; names of expressions end with them.
    fn inside(&mut self, block: &'m Block, mask: &str) -> Written<()> {
        let known = self.text.known.clone();
        self.text.indent += 1;
        self.block(block, mask)?;
        self.text.indent -= 1;
        self.text.known = known;
        Ok(())
    }

    fn block(&mut self, block: &'m Block, mask: &str) -> Written<()> {
        let statements: Vec<&'m Statement> = block.iter().collect();
        self.sequence(&statements, mask)
    }

    fn sequence(&mut self, statements: &[&'m Statement], mask: &str) -> Written<()> {
        for (i, statement) in statements.iter().enumerate() {
            self.statement(statement, mask)?;
            let by_lane = self.depth > 0;
            let left = leaves(self.text.unit, self.text.function, statement, by_lane);
            let rest = &statements[i + 1..];
            if !left.any() || rest.is_empty() {
                continue;
            }
            // Those that are left do the rest, if there are any.
            let mut still = mask.to_owned();
            match self.loops.last() {
                Some(open) => {
                    still = format!("L::and({still}, {})", open.on);
                    if let Some(next) = &open.next {
                        still = format!("L::and({still}, L::not({next}))");
                    }
                }
                None => still = format!("L::and({still}, L::not(done))"),
            }
            let name = self.text.fresh("m");
            self.text.line(&format!("let {name} = {still};"));
            self.text.line(&format!("if L::any({name}) {{"));
            let known = self.text.known.clone();
            self.text.indent += 1;
            self.sequence(rest, &name)?;
            self.text.indent -= 1;
            self.text.known = known;
            self.text.line("}");
            return Ok(());
        }
        Ok(())
    }

    /// What `a && b` and `a || b` became: a branch that only sets a variable of the front end, which
    /// is read at once. Evaluating both sides costs less than the branch.
    fn short_circuit(
        &mut self,
        condition: Handle<Expression>,
        [accept, reject]: [&'m Block; 2],
    ) -> Written<bool> {
        let function = self.text.function;
        let store_of = |block: &'m Block| match block.last() {
            Some(Statement::Store { pointer, value }) => match function.expressions[*pointer] {
                Expression::LocalVariable(local)
                    if function.local_variables[local].name.is_none() =>
                {
                    Some((local, *value))
                }
                _ => None,
            },
            _ => None,
        };
        let (Some((local, value)), Some((same, fixed))) = (store_of(accept), store_of(reject))
        else {
            return Ok(false);
        };
        let fixed = match &function.expressions[fixed] {
            Expression::Literal(Literal::Bool(fixed)) => *fixed,
            _ => return Ok(false),
        };
        let emits = &accept[..accept.len() - 1];
        let is_short = emits
            .iter()
            .all(|statement| matches!(statement, Statement::Emit(_)));
        if local != same || reject.len() != 1 || !is_short {
            return Ok(false);
        }
        let condition = self.text.atom(condition)?;
        for statement in emits {
            if let Statement::Emit(range) = statement {
                self.text.emit(range)?;
            }
        }
        let value = self.text.value(value)?;
        let target = self.text.locals[&local].clone();
        let both = if fixed {
            format!("L::or(L::not({condition}), {value})")
        } else {
            format!("L::and({condition}, {value})")
        };
        self.text.line(&format!("{target} = {both};"));
        Ok(true)
    }

    fn branch(
        &mut self,
        condition: Handle<Expression>,
        [accept, reject]: [&'m Block; 2],
        mask: &str,
    ) -> Written<()> {
        if let Some(text) = self.text.uniform(condition) {
            self.text.line(&format!("if {text} {{"));
            self.inside(accept, mask)?;
            if !reject.is_empty() {
                self.text.line("} else {");
                self.inside(reject, mask)?;
            }
            self.text.line("}");
            return Ok(());
        }
        if self.short_circuit(condition, [accept, reject])? {
            return Ok(());
        }
        let condition = self.text.atom(condition)?;
        self.depth += 1;
        let sides = [
            (accept, condition.clone()),
            (reject, format!("L::not({condition})")),
        ];
        for (block, condition) in sides {
            if block.is_empty() {
                continue;
            }
            let name = self.text.fresh("m");
            self.text
                .line(&format!("let {name} = L::and({mask}, {condition});"));
            // Leaving a loop costs less than to find out whether a lane does.
            if let [Statement::Break | Statement::Continue] = &block[..] {
                self.block(block, &name)?;
                continue;
            }
            self.text.line(&format!("if L::any({name}) {{"));
            self.inside(block, &name)?;
            self.text.line("}");
        }
        self.depth -= 1;
        Ok(())
    }

    fn statement(&mut self, statement: &'m Statement, mask: &str) -> Written<()> {
        match statement {
            Statement::Emit(range) => self.text.emit(range),
            Statement::Block(block) => self.block(block, mask),
            Statement::If {
                condition,
                accept,
                reject,
            } => self.branch(*condition, [accept, reject], mask),
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => {
                let on = self.text.fresh("on");
                self.text.line(&format!("let mut {on} = {mask};"));
                self.text.line(&format!("while L::any({on}) {{"));
                let next = continues(body).then(|| self.text.fresh("next"));
                self.text.indent += 1;
                if let Some(next) = &next {
                    self.text.line(&format!("let mut {next} = L::mask(false);"));
                }
                let round = self.text.fresh("m");
                self.text.line(&format!("let {round} = {on};"));
                self.text.indent -= 1;
                self.loops.push(OpenLoop {
                    on: on.clone(),
                    next,
                });
                self.depth += 1;
                let known = self.text.known.clone();
                self.text.indent += 1;
                // What the body names is known to what continues it.
                self.block(body, &round)?;
                self.block(continuing, &on)?;
                if let Some(condition) = break_if {
                    let condition = self.text.atom(*condition)?;
                    self.text
                        .line(&format!("{on} = L::and({on}, L::not({condition}));"));
                }
                self.text.indent -= 1;
                self.text.known = known;
                self.depth -= 1;
                self.loops.pop();
                self.text.line("}");
                Ok(())
            }
            Statement::Break => {
                let open = self.loops.last().ok_or("a break outside of a loop")?;
                let text = format!("{0} = L::and({0}, L::not({mask}));", open.on);
                self.text.line(&text);
                Ok(())
            }
            Statement::Continue => {
                let open = self.loops.last().ok_or("a continue outside of a loop")?;
                let next = open.next.clone().ok_or("a continue that was not seen")?;
                self.text.line(&format!("{next} = L::or({next}, {mask});"));
                Ok(())
            }
            Statement::Return { value } => self.leave(*value, mask),
            Statement::Store { pointer, value } => {
                let target = self.text.target(*pointer)?;
                if self.depth == 0 {
                    let value = self.text.value(*value)?;
                    self.text.line(&format!("{target} = {value};"));
                    return Ok(());
                }
                let inner = self.text.inner(*value);
                let value = self.text.atom(*value)?;
                let blend = self.text.unit.blend(inner, mask, &value, &target)?;
                self.text.line(&format!("{target} = {blend};"));
                Ok(())
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => {
                let needs = self.text.unit.needs.get(&function.index());
                let needs = *needs.ok_or("a function that is called before it is known")?;
                let mut texts = Vec::new();
                if needs.bound {
                    texts.push("bound".to_owned());
                }
                if needs.lanes {
                    texts.push(mask.to_owned());
                }
                for argument in arguments {
                    texts.push(self.text.value(*argument)?);
                }
                let callee = self.text.unit.function_name(*function);
                let call = format!("{callee}{}({})", turbofish(needs), texts.join(", "));
                let Some(result) = result else {
                    return Err(format!("{callee} is called for no result").into());
                };
                let given = self.text.function.named_expressions.get(result);
                let name = self.text.fresh(given.map_or("t", String::as_str));
                self.text.line(&format!("let {name} = {call};"));
                self.text.known.insert(*result, name);
                Ok(())
            }
            other => Err(format!("the statement {other:?} has no lanes").into()),
        }
    }

    fn leave(&mut self, value: Option<Handle<Expression>>, mask: &str) -> Written<()> {
        let (Some(value), Some(inner)) = (value, self.result) else {
            return Err("a return without a value".into());
        };
        if self.depth == 0 {
            let text = if self.returns_by_lane {
                let value = self.text.atom(value)?;
                self.text.unit.blend(inner, "done", "result", &value)?
            } else {
                self.text.value(value)?
            };
            self.text.line(&format!("return {text};"));
            return Ok(());
        }
        let value = self.text.atom(value)?;
        let blend = self.text.unit.blend(inner, mask, &value, "result")?;
        self.text.line(&format!("result = {blend};"));
        self.text.line(&format!("done = L::or(done, {mask});"));
        for i in 0..self.loops.len() {
            let text = format!("{0} = L::and({0}, L::not({mask}));", self.loops[i].on);
            self.text.line(&text);
        }
        Ok(())
    }
}
