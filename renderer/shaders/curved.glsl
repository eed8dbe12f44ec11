// Converts the way of a ray below a curved mesh to a way through the flat sample. Surfaces of equal
// depth below the mesh are parallel to the mesh. The length of a step of 1 in a texture coordinate
// changes along the mesh.
in vec2 tile_size;
in vec3 bending;
in vec4 stretching;

uniform vec2 mdf_size; // size of a tile, mm

const float MIN_GROWN = 0.25, MAX_GROWN = 4.0;

// Returns the length on the mesh of one millimetre of the sample: along u, along v, and along the
// normal.
vec3 mesh_mm() {
    vec3 mm = vec3(tile_size / mdf_size, 0.0);
    mm.z = sqrt(mm.x * mm.y);
    return mm;
}

// The state of a ray that is marched. The foot is the point of the mesh that is nearest to the ray.
// The frame of tangent, bitangent and normal moves with the foot.
struct marched {
    vec2 along;  // direction of the ray in the tangent plane
    float down;  // component of the direction towards greater depth
    float depth; // depth below the mesh
    vec2 foot;   // vector on the mesh from the point where the ray entered to the foot
    vec2 x;      // texture coordinates of the foot, in tiles
    float mm;    // length of the last step in the flat sample, mm
};

// Returns the velocity of the foot if the ray moves with the velocity w parallel to the tangent
// plane. This velocity is (1 − depth · B)⁻¹ w. B (the argument b) is the second fundamental form of
// the mesh.
vec2 foot_step(mat2 b, vec2 w, float depth) {
    float trace = b[0][0] + b[1][1];
    float det = 1.0 - depth * trace + depth * depth * (b[0][0] * b[1][1] - b[0][1] * b[1][0]);
    return det > 0.05 ? ((1.0 - depth * trace) * w + depth * (b * w)) / det : w;
}

// Returns two factors: how much longer a step of 1 in u and in v is at the foot than where the ray
// enters.
vec2 grown_at(vec2 foot) {
    return clamp(1.0 + vec2(dot(stretching.xy, foot), dot(stretching.zw, foot)), MIN_GROWN,
                 MAX_GROWN);
}

// Moves the ray further by dt, by the midpoint rule. The direction in the frame changes because the
// frame turns. The frame turns about an axis in the tangent plane because the mesh is curved (b).
// It also turns about the normal because the lines of equal u and v bend.
void march(inout marched m, mat2 b, vec3 mm, float dt) {
    vec2 turn = b * foot_step(b, m.along, m.depth);
    vec2 along = m.along + 0.5 * dt * m.down * turn;
    float down = m.down - 0.5 * dt * dot(m.along, turn);
    vec2 foot = foot_step(b, along, m.depth + 0.5 * dt * m.down);
    vec2 grown = grown_at(m.foot + 0.5 * dt * foot), way = dt * foot / (tile_size * grown);
    float scale = mm.z * sqrt(grown.x * grown.y);
    turn = b * foot;
    m.foot += dt * foot;
    m.x += vec2(way.x, -way.y);
    m.depth += dt * down;
    m.mm = length(vec3(way * mdf_size, dt * down / scale));
    float about = dt * (foot.y * stretching.z / grown.y - foot.x * stretching.y / grown.x);
    vec3 next = vec3(m.along + dt * down * turn, m.down - dt * dot(along, turn));
    next.xy += about * vec2(next.y, -next.x);
    next *= inversesqrt(dot(next, next));
    m.along = next.xy;
    m.down = next.z;
}

#if CURVED
uniform bool curved; // if FALSE, the ray ends where it enters
const int END_STEPS = 3;
const float MIN_RISE = 0.3; // smallest tangent of the angle between the mesh and ray_end.v

// The end of a ray. A straight ray that enters the flat sample at texel and goes in the direction
// −v ends at the same point of the sample.
struct ray_end {
    vec2 texel;
    vec3 v;
    mat3 turn;      // rotation from the frame where the ray enters to the frame at its end
    vec2 foot;      // point of the mesh nearest to the end, in tiles
    float depth_mm; // depth of the end below the reference plane of the flat sample
};

// Returns the end of a ray that goes on below the mesh for the distance way. v is the direction
// towards the eye where the ray enters.
ray_end find_end(vec3 v, float way) {
    ray_end end = ray_end(texel, v, mat3(1.0), texel, 0.0);
    if (!curved)
        return end;
    mat2 b = mat2(bending.x, bending.y, bending.y, bending.z);
    vec3 mm = mesh_mm();
    marched m = marched(-v.xy, v.z, 0.0, vec2(0.0), texel, 0.0);
    for (int k = 0; k < END_STEPS && m.down > 0.0; k++)
        march(m, b, mm, way / float(END_STEPS));
    vec2 grown = grown_at(m.foot);
    float scale = sqrt(grown.x * grown.y);
    vec2 along = m.along * scale / grown;
    end.v = normalize(vec3(-along, max(m.down, MIN_RISE * length(along))));
    end.foot = m.x;
    end.depth_mm = m.depth / (mm.z * scale);
    end.texel = m.x + end.depth_mm * vec2(end.v.x, -end.v.y) / end.v.z / mdf_size;
    vec2 turn = b * m.foot;
    float angle = length(turn), c = cos(angle), s = sin(angle);
    vec2 t = angle > 1e-6 ? turn / angle : vec2(1.0, 0.0);
    mat3 basis = mat3(vec3(t, 0.0), vec3(-t.y, t.x, 0.0), vec3(0.0, 0.0, 1.0));
    mat3 rotation = mat3(vec3(c, 0.0, s), vec3(0.0, 1.0, 0.0), vec3(-s, 0.0, c));
    end.turn = basis * rotation * transpose(basis);
    return end;
}
#endif
