/*
 * The contract of a drawing method, which draws a compressed form of a BTF. A method reads its
 * file, uploads it to the graphics card, and supplies the shader function that evaluates it. The
 * rest of a picture is the same for all methods. methods.h lists them.
 */
#pragma once

#include "btf/btf_layout.h"

typedef struct Directions Directions; /* directions/directions.h */

#define METHOD_SHADERS 6
/* The texture units 0 … 7 belong to the method. The viewer and the relief use higher units. */
#define METHOD_UNITS 8

/* How microfacets follow a normal that differs from the normal of the surface (Kang & Cho 2011). */
enum method_rotation {
    METHOD_ROTATION_EXACT,       /* eq. 4 … 6 */
    METHOD_ROTATION_APPROXIMATE, /* eq. 9 … 11; not orthonormal if the normal leans along y */
    METHOD_ROTATION_NONE,        /* plain normal mapping, eq. 2 */
    METHOD_ROTATIONS
};

struct method_style {
    gboolean nearest; /* texels are not filtered */
    enum method_rotation rotation;
};

struct method {
    const char *name;    /* value of --method */
    const char *title;   /* name for users */
    const char *product; /* file in products/ of a session; NULL if the method needs no file */
    const char *made_by; /* command that makes the file; NULL if the method needs no file */
    /* whether a normal map (normal_map.h) may replace the method's normals */
    gboolean takes_normals;
    /* Files of renderer/shaders, at most METHOD_SHADERS, NULL-terminated. directions.glsl comes
     * before them. They define
     *   vec3 btf(vec2 x, vec3 v, vec3 l, float lit)
     * x are texel coordinates (in tiles, y along the texture's rows downwards). v and l are unit
     * vectors in the texture's frame (+y upwards). The result is lit × the reflectance under the
     * light l, plus the uniform float ambient × the reflectance under an even sky. lit is 0 in a
     * shadow and 1 elsewhere.
     *
     * Textures of texels are read by PLACE_TEXTURE(sampler, x) or texelFetch(). Tables are read by
     * textureLod(). texture(), dFdx() and dFdy() are not allowed, because the next pixel may show
     * another part of the sample (places.glsl).
     *
     * If the work of a method for the directions is the same for all texels, the files also define
     * BTF_PREPARED and the two halves of btf():
     *   void btf_prepare(vec3 v, vec3 l, float lit)
     *   vec3 btf_texel(vec2 x) */
    const char *const *shaders;
    /* The following functions belong to the thread of the GL context. open() reads a file and
     * uploads it to the card. For a method without a material file, path names a normal map, or is
     * NULL. */
    gpointer (*open)(const char *path, GError **error);
    void (*free)(gpointer material);
    /* Returns the constants of the shaders as lines “#define NAME value”. Free them with g_free().
     * The function pointer is NULL if there are no constants. */
    char *(*constants)(gconstpointer material, const struct method_style *style);
    gint64 (*bytes)(gconstpointer material); /* bytes of GPU memory */
    /* Computes the numbers of columns and rows of the sample. Returns TRUE. The function pointer is
     * NULL for a method without a material file. */
    gboolean (*texels)(gconstpointer material, int ret[2]);
    /* Sets textures and uniforms of a program that has the shaders. The program must be in use. */
    void (*bind)(gpointer material, guint program, const struct method_style *style);
};

extern const char *const method_rotation_names[METHOD_ROTATIONS]; /* values of --rotation */

/* For methods: makes a table of directions. Errors begin with what, which is "views" or
 * "lights". */
Directions *method_directions(const struct direction_list *list, const char *what,
                              gboolean triangulated, GError **error);
/* For methods: checks that a texture of the card can have this number of texels. */
gboolean method_check_size(const struct btf_layout *layout, GError **error);
