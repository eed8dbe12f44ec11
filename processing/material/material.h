/* A material that Mesorig has measured, for use in renderers: its reflectance, the intersection of
 * a ray with its relief, and importance sampling of light directions. Installed as
 * <mesorig/material.h>; link with `pkg-config --cflags --libs mesorig-material`. The header is
 * plain C, and can be used in C++.
 *
 * Several threads may call the functions at the same time with the same material. Only
 * mesorig_material_close() must not run while another call uses the material.
 *
 * Frame of the sample: x to the right, y upwards, z out of the surface. Texture coordinates u, v
 * are in tiles, with u along x. v goes downwards over the rows of the texture, against y. The
 * material repeats in u and v. Directions point outwards from the surface; the functions normalise
 * them. “view” points to the eye, “light” to the lamp.
 *
 * Values are reflected radiance, linear sRGB, relative to that of a white diffuser lit from its
 * normal by the same lamp. Values contain n·l: f_r = value / (π cos θ_light). A renderer therefore
 * multiplies the lamp's irradiance on a surface that faces the lamp by value / π.
 *
 * Functions that return an int return one of enum mesorig_status. They write their results only if
 * they return MESORIG_OK. */
#ifndef MESORIG_MATERIAL_H
#define MESORIG_MATERIAL_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum mesorig_status {
    MESORIG_OK = 0,
    MESORIG_ERROR_ARGUMENT, /* an argument is NULL, or a struct has an unknown size */
    MESORIG_ERROR_FILE,     /* the file does not exist, or cannot be read */
    MESORIG_ERROR_FORMAT,   /* the file is not a material, is damaged, or lacks something */
    MESORIG_ERROR_MEMORY    /* the material or a call needs too much memory */
};

/* text is a sentence in English, in UTF-8, that names the file and says what to do. */
struct mesorig_error {
    int status;
    char text[512];
};

typedef struct mesorig_material mesorig_material;

/* Opens a material in any form: a file that “mesorig compress” or “mesorig process” wrote, a
 * session directory, or its products/btf. mdf is a file of the material's distances (MDF). If mdf
 * is NULL, the MDF of the session is used if path is a session directory or its products/btf and
 * the session has an MDF. In all other cases without mdf, the material has no relief.
 *
 * Of a session directory, the BTF itself is used if it exists, otherwise the compressed BTF with
 * the smallest error. All values of a BTF are kept in memory, four bytes each.
 *
 * On failure, returns NULL and fills ret_error, which may be NULL. */
mesorig_material *mesorig_material_open(const char *path, const char *mdf,
                                        struct mesorig_error *ret_error);

/* Opens a material from the bytes of such files, which may be freed afterwards. If mdf is NULL, the
 * material has no relief. Failures are reported as by mesorig_material_open(). */
mesorig_material *mesorig_material_open_memory(const void *material, size_t material_bytes,
                                               const void *mdf, size_t mdf_bytes,
                                               struct mesorig_error *ret_error);

/* Closes a material. No other call may use the material at the same time. NULL is ignored. */
void mesorig_material_close(mesorig_material *material);

struct mesorig_material_info {
    size_t size;      /* sizeof of this struct as the caller was compiled with; set by the caller */
    const char *kind; /* the codec: "btf", "lpca", "eigenmaps", …; valid as long as the material */
    int width, height;     /* texels of a tile */
    int n_views, n_lights; /* number of measured directions, or of samples of a grid of them */
    double texel_mm;       /* width of a texel; 0 if not known */
    /* maximum depth of the relief below the reference plane; 0 if there is none */
    double deepest_mm;
    int has_relief; /* 1 if there is an MDF */
    double error; /* ‖compressed − BTF‖ / ‖BTF‖ of the codec; 0 for a BTF; −1 if not known */
};

/* Sets the members that lie within the first info->size bytes of the struct. */
int mesorig_material_info(const mesorig_material *material, struct mesorig_material_info *info);

/* Gives the directions of the views and lights that were measured, as unit vectors: n_views × 3 and
 * n_lights × 3. Either may be NULL. */
int mesorig_material_directions(const mesorig_material *material, float *ret_views,
                                float *ret_lights);

/* Evaluates n points. uv is n × 2; view and light are n × 3. footprint (n) is the diameter of a
 * pixel's footprint in tiles, 0 for a point; NULL means all 0. ret_rgb is n × 3 (R, G, B), not
 * negative.
 *
 * Between texels, values are interpolated bilinearly. Neural planes are evaluated at the point
 * itself, with one ray in their relief, and always have mip levels. If the footprint is above 0,
 * values are averaged over a square of its width. In a square wider than 16 texels, 16 × 16 texels
 * count. If the file has mip levels, the two nearest levels are mixed instead of averaging.
 *
 * Between measured directions, values are interpolated (bilinearly in θ and φ, or in a triangle).
 * For lights below the lowest measured one, values fall in proportion to cos θ. Models that are a
 * formula of the directions are evaluated by this formula. The result is 0 if a view or light is on
 * or below the horizon, or if an argument is not finite. */
int mesorig_material_evaluate(const mesorig_material *material, size_t n, const float *uv,
                              const float *view, const float *light, const float *footprint,
                              float *ret_rgb);

/* The point where a ray meets the surface. The ray enters the reference plane at (u, v) and
 * continues along −view. */
struct mesorig_hit {
    /* 1 if there is a point, otherwise 0. It is 0 if the view is not above the horizon, or if an
     * argument is not finite. All other members are then 0. */
    int hit;
    /* distance along the ray from the reference plane to the point; the reference plane is above
     * the whole surface */
    float distance_mm;
    /* texture coordinates of the place on the reference plane vertically above the point; not
     * wrapped */
    float uv[2];
    float normal[3]; /* unit normal of the surface at the point, as seen in this view */
};

/* Intersects n rays with the flat sample. uv is n × 2, view is n × 3. The distance is that of the
 * MDF (Wang et al. 2005 §3), interpolated between texels and views. Where interpolation would mix
 * two surfaces, a ray is marched through a volume made from the MDF instead. The distance is
 * therefore also valid for structure that no height field describes, such as grass. Without relief
 * the surface is the reference plane. The first call prepares the volume. */
int mesorig_material_intersect(const mesorig_material *material, size_t n, const float *uv,
                               const float *view, struct mesorig_hit *ret);

/* A mesh at the point where a ray enters, in the frame of tangent (along u), bitangent (against v)
 * and normal. Lengths are in the unit of the caller, the same for all. */
struct mesorig_surface {
    float tile[2]; /* length of a tile along u and along v */
    /* second fundamental form (L, M, N). The normal curvature along the unit vector (a, b) is
     * L a² + 2 M a b + N b², positive where the mesh bends away; 0 for a flat mesh */
    float bend[3];
    /* gradients along tangent and bitangent, first of ln tile[0], then of ln tile[1] */
    float stretch[4];
};

/* Marches n rays through the relief of a curved mesh, for silhouettes and shadows. uv is n × 2,
 * view is n × 3 and points against the ray, in the frame of the mesh. surface has n elements. limit
 * (n) is the distance at which a ray ends, in the unit of the caller; NULL means that no ray ends.
 * ret_distance (n) is the distance from the mesh to the structure, in the unit of the caller. It is
 * −1 if an argument is not valid, or if the ray does not meet the structure before its limit.
 *
 * A ray that meets no structure leaves the mesh again through a back face. The ray can be marched
 * from both ends, from the front face and from the back face, each half with a limit. Both halves
 * then stay nearer to the mesh.
 *
 * Without relief all distances are 0. The first call prepares the volume of
 * mesorig_material_intersect(). */
int mesorig_material_march(const mesorig_material *material, size_t n, const float *uv,
                           const float *view, const struct mesorig_surface *surface,
                           const float *limit, float *ret_distance);

/* Draws n light directions with a density approximately proportional to the light that the material
 * reflects to the view. random is n × 2 in [0, 1); ret_light is n × 3. ret_pdf (n) is the density
 * per solid angle, or 0 if there is no direction. The other arguments are as in
 * mesorig_material_evaluate(). The first call prepares tables. */
int mesorig_material_sample(const mesorig_material *material, size_t n, const float *uv,
                            const float *view, const float *footprint, const float *random,
                            float *ret_light, float *ret_pdf);

/* Gives the density with which mesorig_material_sample() draws the given lights. ret_pdf has n
 * values. */
int mesorig_material_pdf(const mesorig_material *material, size_t n, const float *uv,
                         const float *view, const float *light, const float *footprint,
                         float *ret_pdf);

#ifdef __cplusplus
}
#endif

#endif
