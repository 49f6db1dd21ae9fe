//! Functions of a shader on the adapter: a compute shader calls one of them for each row of words.

use std::collections::BTreeMap;

use naga::{AddressSpace, Function, GlobalVariable, Handle, Module, ScalarKind, TypeInner};
use sensor_gpu::{CopyBatch, Gpu, Place};

/// Words of a type.
pub fn n_words(module: &Module, inner: &TypeInner) -> usize {
    match inner {
        TypeInner::Vector { size, .. } => *size as usize,
        TypeInner::Array { base, size, .. } => {
            let naga::ArraySize::Constant(n) = size else {
                panic!("{inner:?} has no end")
            };
            n.get() as usize * n_words(module, &module.types[*base].inner)
        }
        TypeInner::Struct { members, .. } => {
            let sizes = members.iter().map(|member| &module.types[member.ty].inner);
            sizes.map(|inner| n_words(module, inner)).sum()
        }
        _ => 1,
    }
}

fn scalar_name(kind: ScalarKind) -> &'static str {
    match kind {
        ScalarKind::Float => "f32",
        ScalarKind::Sint => "i32",
        ScalarKind::Bool => "bool",
        _ => "u32",
    }
}

fn type_name(module: &Module, ty: Handle<naga::Type>) -> String {
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => scalar_name(scalar.kind).to_owned(),
        TypeInner::Vector { size, scalar } => {
            format!("vec{}<{}>", *size as u8, scalar_name(scalar.kind))
        }
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => format!("array<{}, {n}>", type_name(module, *base)),
        _ => module.types[ty].name.clone().expect("structs have names"),
    }
}

fn scalar_argument(kind: ScalarKind, next: &mut usize) -> String {
    let word = format!("rows_in[i + {next}u]");
    *next += 1;
    match kind {
        ScalarKind::Float => format!("bitcast<f32>({word})"),
        ScalarKind::Sint => format!("bitcast<i32>({word})"),
        ScalarKind::Bool => format!("({word} != 0u)"),
        _ => word,
    }
}

fn argument(module: &Module, ty: Handle<naga::Type>, next: &mut usize) -> String {
    let parts: Vec<String> = match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => return scalar_argument(scalar.kind, next),
        TypeInner::Vector { size, scalar } => (0..*size as u8)
            .map(|_| scalar_argument(scalar.kind, next))
            .collect(),
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => (0..n.get())
            .map(|_| argument(module, *base, next))
            .collect(),
        TypeInner::Struct { members, .. } => members
            .iter()
            .map(|member| argument(module, member.ty, next))
            .collect(),
        other => panic!("an argument of type {other:?}"),
    };
    format!("{}({})", type_name(module, ty), parts.join(", "))
}

fn results(module: &Module, inner: &TypeInner, path: &str, out: &mut Vec<String>) {
    let scalar = |kind: ScalarKind, path: &str| match kind {
        ScalarKind::Float | ScalarKind::Sint => format!("bitcast<u32>({path})"),
        ScalarKind::Bool => format!("u32({path})"),
        _ => path.to_owned(),
    };
    match inner {
        TypeInner::Scalar(of) => out.push(scalar(of.kind, path)),
        TypeInner::Vector { size, scalar: of } => {
            out.extend((0..*size as u8).map(|i| scalar(of.kind, &format!("{path}[{i}]"))));
        }
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => {
            for i in 0..n.get() {
                let part = &module.types[*base].inner;
                results(module, part, &format!("{path}[{i}]"), out);
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                let name = member.name.as_deref().expect("members have names");
                let part = &module.types[member.ty].inner;
                results(module, part, &format!("{path}.{name}"), out);
            }
        }
        other => panic!("a result of type {other:?}"),
    }
}

/// The shader with an entry point that calls a function for each row.
pub fn with_entry(text: &str, module: &Module, function: &Function) -> String {
    let mut next = 0;
    let arguments: Vec<String> = function
        .arguments
        .iter()
        .map(|of| argument(module, of.ty, &mut next))
        .collect();
    let result = function.result.as_ref().expect("there is a result");
    let mut words = Vec::new();
    results(module, &module.types[result.ty].inner, "r", &mut words);
    let mut stores = String::new();
    for (i, word) in words.iter().enumerate() {
        stores += &format!("    rows_out[o + {i}u] = {word};\n");
    }
    let name = function.name.as_deref().expect("functions have names");
    format!(
        "{text}\n@group(3) @binding(0) var<storage, read> rows_in: array<u32>;\n\
         @group(3) @binding(1) var<storage, read_write> rows_out: array<u32>;\n\
         @compute @workgroup_size(64)\n\
         fn cs_rows(@builtin(global_invocation_id) row: vec3<u32>) {{\n    \
         let i = row.x * {next}u;\n    let o = row.x * {}u;\n    \
         var r = {name}({});\n{stores}}}\n",
        words.len(),
        arguments.join(", ")
    )
}

/// What a shader reads, by the names of its variables.
pub struct Resources<'r> {
    pub buffers: BTreeMap<&'static str, &'r [u8]>,
    pub texture: &'r dyn Fn(&str) -> wgpu::Texture,
}

enum Held {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

fn sampler(gpu: &Gpu, name: &str) -> wgpu::Sampler {
    let address = match name {
        "noise_sampler" => wgpu::AddressMode::Repeat,
        _ => wgpu::AddressMode::ClampToEdge,
    };
    gpu.device().create_sampler(&wgpu::SamplerDescriptor {
        label: Some(name),
        address_mode_u: address,
        address_mode_v: address,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        compare: (name == "shadow_sampler").then_some(wgpu::CompareFunction::LessEqual),
        ..Default::default()
    })
}

/// The results of a function for rows of words.
pub fn results_on(
    gpu: &Gpu,
    text: &str,
    constants: &[(&str, f64)],
    resources: &Resources<'_>,
    rows: &[u32],
    [n_rows, n_out]: [usize; 2],
) -> Vec<u32> {
    let module = naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
    let info = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::empty(),
    )
    .validate(&module)
    .expect("the shader is valid");
    let is_used = |handle: Handle<GlobalVariable>| !info.get_entry_point(0)[handle].is_empty();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM;
    let out_bytes = 4 * n_rows * n_out;
    let out = gpu.buffer(
        "rows out",
        out_bytes as u64,
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
    );
    let mut held: BTreeMap<(u32, u32), Held> = BTreeMap::new();
    for (handle, variable) in module.global_variables.iter() {
        let Some(binding) = variable.binding.as_ref().filter(|_| is_used(handle)) else {
            continue;
        };
        let name = variable.name.as_deref().expect("variables have names");
        let of = match (variable.space, name) {
            (_, "rows_in") => {
                Held::Buffer(gpu.buffer_with(name, bytemuck::cast_slice(rows), usage))
            }
            (_, "rows_out") => Held::Buffer(out.clone()),
            (AddressSpace::Uniform | AddressSpace::Storage { .. }, _) => {
                Held::Buffer(gpu.buffer_with(name, resources.buffers[name], usage))
            }
            _ if name.ends_with("_sampler") => Held::Sampler(sampler(gpu, name)),
            _ => Held::View((resources.texture)(name).create_view(&Default::default())),
        };
        held.insert((binding.group, binding.binding), of);
    }
    let device = gpu.device();
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("rows"),
        layout: None,
        module: &gpu.shader("rows", text),
        entry_point: Some("cs_rows"),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants,
            ..Default::default()
        },
        cache: None,
    });
    let groups: Vec<Option<wgpu::BindGroup>> = (0..4)
        .map(|group| {
            let entries: Vec<wgpu::BindGroupEntry<'_>> = held
                .iter()
                .filter(|((of, _), _)| *of == group)
                .map(|((_, binding), held)| wgpu::BindGroupEntry {
                    binding: *binding,
                    resource: match held {
                        Held::Buffer(buffer) => buffer.as_entire_binding(),
                        Held::View(view) => wgpu::BindingResource::TextureView(view),
                        Held::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                    },
                })
                .collect();
            (!entries.is_empty()).then(|| {
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("rows"),
                    layout: &pipeline.get_bind_group_layout(group),
                    entries: &entries,
                })
            })
        })
        .collect();
    let mut encoder = gpu.encoder("rows");
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    for (group, bound) in (0..).zip(&groups) {
        if let Some(bound) = bound {
            pass.set_bind_group(group, bound, &[]);
        }
    }
    pass.dispatch_workgroups(n_rows.div_ceil(64) as u32, 1, 1);
    drop(pass);
    let mut bytes = vec![0; out_bytes];
    let mut batch = CopyBatch::new();
    batch.buffer(&out, 0, out_bytes, Place::Memory(&mut bytes));
    batch
        .submit(gpu, encoder)
        .wait()
        .expect("the rows are computed");
    bytemuck::pod_collect_to_vec(&bytes)
}
