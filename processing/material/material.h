/*
 * A material that Mesorig has measured, for renderers: what it reflects, where a ray meets its
 * relief, and light directions that matter. Installed as <mesorig/material.h>; link with
 * `pkg-config --cflags --libs mesorig-material`. Plain C, C++ as well.
 *
 * Everything but open and close may be called from any number of threads at once with one material.
 *
 * Frame of the sample: x to the right, y upwards, z out of the surface. Texture coordinates u, v
 * are in tiles, u along x and v downwards along the texture's rows, against y; they repeat.
 * Directions point outwards from the surface; they are normalised. “view” points to the eye,
 * “light” to the lamp.
 *
 * Values are reflected radiance, linear sRGB, relative to that of a white diffuser lit from its
 * normal by the same lamp. They contain n·l: f_r = value / (π cos θ_light), so that a renderer
 * multiplies the lamp's irradiance on a surface facing it by value / π.
 *
 * Functions that return an int return one of enum mesorig_status. What they write to is not touched
 * unless that is MESORIG_OK.
 */
#ifndef MESORIG_MATERIAL_H
#define MESORIG_MATERIAL_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum mesorig_status {
    MESORIG_OK = 0,
    MESORIG_ERROR_ARGUMENT, /* NULL, or a struct of unknown size */
    MESORIG_ERROR_FILE,     /* it is not there, or cannot be read */
    MESORIG_ERROR_FORMAT,   /* it is no material, is damaged, or lacks something */
    MESORIG_ERROR_MEMORY    /* too large */
};

/* text: a sentence in English, in UTF-8, that names the file and says what to do. */
struct mesorig_error {
    int status;
    char text[512];
};

typedef struct mesorig_material mesorig_material;

/* Opens a material in any form: a file that “mesorig compress” or “mesorig process” wrote, a
 * session directory, or its products/btf. mdf: a file of its distances (MDF). NULL: the MDF of the
 * session directory, if path is one and has an MDF; otherwise the material has no relief. From a
 * session's products the BTF itself is taken if it is there, else the compressed one with the least
 * error. All values of a BTF are held in memory, four bytes each. NULL with ret_error, which may be
 * NULL, filled. */
mesorig_material *mesorig_material_open(const char *path, const char *mdf,
                                        struct mesorig_error *ret_error);

/* The same from the bytes of such files, which may be freed afterwards. mdf NULL: no relief. */
mesorig_material *mesorig_material_open_memory(const void *material, size_t material_bytes,
                                               const void *mdf, size_t mdf_bytes,
                                               struct mesorig_error *ret_error);

/* No other call may use the material meanwhile. NULL is ignored. */
void mesorig_material_close(mesorig_material *material);

struct mesorig_material_info {
    size_t size;      /* sizeof of this struct as the caller was compiled with; set by the caller */
    const char *kind; /* the codec: "btf", "lpca", "eigenmaps", … ; lives as long as the material */
    int width, height;     /* texels of a tile */
    int n_views, n_lights; /* measured directions, or samples of a grid of them */
    double texel_mm;       /* width of a texel, 0: not known */
    double deepest_mm;     /* of the relief below the reference plane, 0: none */
    int has_relief;        /* 1: there is an MDF */
    double error; /* ‖compressed − BTF‖ / ‖BTF‖ of the codec, 0 of a BTF; −1: not known */
};

/* Sets as many members as info->size has room for. */
int mesorig_material_info(const mesorig_material *material, struct mesorig_material_info *info);

/* Gives the directions of the views and lights that were measured, as unit vectors: n_views × 3 and
 * n_lights × 3. Either may be NULL. */
int mesorig_material_directions(const mesorig_material *material, float *ret_views,
                                float *ret_lights);

/* Values of n points. uv: n × 2; view, light: n × 3; footprint: n, the diameter of a pixel's
 * footprint in tiles, 0: a point; NULL: all 0. ret_rgb: n × 3 (R, G, B), not negative.
 *
 * Between texels values are bilinear. Over a footprint they are averaged over a square of that
 * width, in which at most 16 × 16 points count; if the file has mip levels, the two nearest levels
 * are mixed instead. Between measured directions they are interpolated (bilinear in θ and φ, or in
 * a triangle); lights below the lowest measured one fall in proportion to cos θ. Models with a
 * formula evaluate it. A view or light below the horizon, or an argument that is not finite, gives
 * 0. */
int mesorig_material_evaluate(const mesorig_material *material, size_t n, const float *uv,
                              const float *view, const float *light, const float *footprint,
                              float *ret_rgb);

/* Where a ray that enters the reference plane at (u, v) and goes on along −view meets the surface.
 */
struct mesorig_hit {
    int hit; /* 0: it does not, as its view is not above the horizon; all else is 0 then */
    float distance_mm; /* along the ray, from the reference plane, which is above all of the surface
                        */
    float uv[2];       /* of that point, straight below it on the reference plane; not wrapped */
    float normal[3];   /* of the surface there, as this view sees it */
};

/* Asks n rays, uv: n × 2, view: n × 3. The distance is that of the MDF (Wang et al. 2005 §3),
 * interpolated between texels and views, so that it holds for structures that no height field
 * describes. Without relief the surface is the reference plane. */
int mesorig_material_intersect(const mesorig_material *material, size_t n, const float *uv,
                               const float *view, struct mesorig_hit *ret);

/* Draws n light directions with a density about proportional to what the material reflects to the
 * view. random: n × 2 in [0, 1); ret_light: n × 3; ret_pdf: n, the density per solid angle, 0 where
 * there is no direction. Arguments as of mesorig_material_evaluate(). The first call prepares
 * tables. */
int mesorig_material_sample(const mesorig_material *material, size_t n, const float *uv,
                            const float *view, const float *footprint, const float *random,
                            float *ret_light, float *ret_pdf);

/* The density with which mesorig_material_sample() draws the given lights. ret_pdf: n. */
int mesorig_material_pdf(const mesorig_material *material, size_t n, const float *uv,
                         const float *view, const float *light, const float *footprint,
                         float *ret_pdf);

#ifdef __cplusplus
}
#endif

#endif
