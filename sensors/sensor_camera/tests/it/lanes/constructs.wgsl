// Every construct that the generator knows, beside those that the cameras' shaders happen to use.

override CHOSEN: bool = true;
override OTHER: bool = false;

struct Pair {
    number: f32,
    word: u32,
    flags: vec2<bool>,
    inside: Inside,
}

struct Inside {
    row: array<f32, 3>,
    signed: vec2<i32>,
}

const STEPS: array<f32, 3> = array<f32, 3>(0.25, 0.5, 2.0);

// Leaves a loop by break, skips a round by continue, and leaves the function from within two loops.
fn rounds(limit: u32, stride: u32) -> vec2<u32> {
    var sum = 0u;
    var n = 0u;
    for (var i = 0u; i < 20u; i++) {
        if i >= limit {
            break;
        }
        if i % 3u == 1u {
            continue;
        }
        for (var k = i; k < 12u; k += 1u + stride % 4u) {
            if k == 11u && i > 4u {
                return vec2(sum + 1000u, n);
            }
            if (k & 1u) == 1u {
                continue;
            }
            sum += k * i;
            n++;
        }
        sum ^= i << 3u;
    }
    return vec2(sum, n);
}

// A loop whose end is tested behind it.
fn halved(number: f32) -> u32 {
    var x = abs(number);
    var n = 0u;
    loop {
        x *= 0.5;
        continuing {
            n += 1u;
            break if x < 1.0 || n > 30u;
        }
    }
    return n;
}

// Returns from branches in branches, and by overrides before and after them.
fn sorted(x: f32, y: f32) -> f32 {
    if OTHER {
        return -1.0;
    }
    if x < 0.0 {
        if y < 0.0 {
            return x * y;
        }
        if y < 0.5 {
            return x - y;
        }
    } else if x > 0.75 {
        return 7.0;
    }
    if CHOSEN {
        return x + 10.0 * y;
    }
    return 5.0;
}

fn changed(given: Pair, by: f32) -> Pair {
    var out = given;
    if by > 0.0 {
        out.number *= by;
        out.inside.row[1] = by;
        out.flags.x = !out.flags.y;
    } else {
        out.word = ~out.word;
        out.inside.signed.y = -out.inside.signed.x;
        out.inside.row = array<f32, 3>(by, 2.0 * by, by * by);
    }
    if all(out.flags) || out.word == 3u {
        out.inside.signed += vec2(1, 2);
    }
    return out;
}

fn called_in_branches(given: Pair, x: f32) -> f32 {
    var sum = 0.0;
    if x > 0.25 {
        sum = changed(given, x).number + sorted(x, given.number);
    } else if any(given.flags) {
        sum = sorted(given.number, x) - 1.0;
    }
    return sum;
}

fn whole_numbers(a: i32, b: i32, c: u32, d: u32) -> array<vec4<u32>, 3> {
    let signed = vec4(min(a, b), max(a, b), clamp(a, -5, 9), a >> (c & 31u));
    let unsigned = vec4(min(c, d), max(c, d), clamp(c, 7u, 90u), c / max(d, 1u));
    let compared = vec4(u32(a < b) + 2u * u32(a <= b), u32(c > d) + 2u * u32(c >= d), u32(c <= d) | u32(a >= b) << 1u | u32(a > b) << 2u, firstTrailingBit(c));
    return array<vec4<u32>, 3>(bitcast<vec4<u32>>(signed), unsigned + c % vec4(7u, 8u, max(d, 1u), 16u), compared ^ vec4(c / 16u));
}

fn numbers_and_words(a: f32, b: i32, c: u32) -> array<vec4<u32>, 2> {
    let bits = vec4(bitcast<u32>(a), u32(i32(a * 1000.0)), u32(abs(a) * 3e6), bitcast<u32>(f32(b)));
    let more = vec4(bitcast<u32>(f32(c)), select(c, 5u, a > 0.0), u32(a != 0.0), bitcast<u32>(f32(a >= 0.5)));
    return array<vec4<u32>, 2>(bits, more);
}

fn functions(x: f32, y: f32) -> array<vec4<f32>, 4> {
    let p = abs(x) + 0.1;
    let v = vec3(x, y, x * y + 1.0);
    return array<vec4<f32>, 4>(
        vec4(exp(-p), exp2(x), log2(p), pow(p, y)),
        vec4(sin(9.0 * x), cos(9.0 * y), atan2(y, x), inverseSqrt(p)),
        vec4(normalize(v), length(v)),
        vec4(fract(8.0 * x), mix(x, y, 0.3), smoothstep(-0.5, 0.5, x), saturate(y)),
    );
}

fn vectors(a: vec3<f32>, b: vec3<f32>) -> array<vec3<f32>, 4> {
    let larger = a > b;
    return array<vec3<f32>, 4>(
        select(a, b.zxy, larger),
        cross(a, b) * dot(a.xy, b.yz),
        floor(a * 4.0) / max(abs(b), vec3(0.125)),
        reflect(a, normalize(b)) + clamp(b, vec3(-0.5), a + 2.0) - sqrt(abs(a)) * STEPS[1],
    );
}

fn packed(word: u32, number: vec4<f32>) -> array<vec4<f32>, 3> {
    let again = unpack4x8unorm(pack4x8unorm(number));
    return array<vec4<f32>, 3>(again, unpack4x8unorm(word), unpack4x8snorm(word));
}
