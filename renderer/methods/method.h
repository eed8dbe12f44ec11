/*
 * The methods of drawing a material, one for each compressed form of a BTF. A method reads its
 * file, uploads it to the graphics card and supplies the shader function that evaluates it; the
 * rest of a picture is the same for all methods.
 */
#pragma once

#include "btf/btf_layout.h"

typedef struct Directions Directions; /* directions/directions.h */

#define METHOD_UNITS                                                                               \
    8 /* texture units 0 … 7 are a method's, higher ones belong to viewer and relief */
#define METHOD_SHADERS 6
#define METHOD_DEMO    "fabric-ashikhmin" /* shown where no material is named or open yet */

/* How microfacets follow a normal that is not the surface's (Kang & Cho 2011). */
enum method_rotation {
    METHOD_ROTATION_EXACT,       /* eq. 4 … 6 */
    METHOD_ROTATION_APPROXIMATE, /* eq. 9 … 11: not orthonormal where the normal leans along y */
    METHOD_ROTATION_NONE,        /* plain normal mapping, eq. 2 */
    METHOD_ROTATIONS
};

struct method_style {
    gboolean nearest; /* no filtering between texels */
    enum method_rotation rotation;
};

struct method {
    const char *name;       /* of --method */
    const char *title;      /* for people */
    const char *product;    /* its file in products/ of a session, and */
    const char *made_by;    /* the command that makes it; both NULL: it needs no file */
    gboolean takes_normals; /* but a normal map (normal_map.h) may take the place of its own */
    /* GLSL files, at most METHOD_SHADERS, NULL-ended. They define
     *   vec3 btf(vec2 x, vec3 v, vec3 l, float lit)
     * at texel coordinates x (in tiles, y along the texture's rows downwards), for unit vectors
     * in its frame (+y upwards): lit × the reflectance under the light l, plus uniform float
     * ambient × that under an even sky. lit is 0 in a shadow, else 1. A method whose work for the
     * directions is the same for all texels defines BTF_PREPARED, void btf_prepare(vec3 v, vec3 l,
     * float lit) and vec3 btf_texel(vec2 x), too, which do the two halves. */
    const char *const *shaders;
    /* The following belong to the thread of the GL context. open reads a file and puts it on the
     * card; for a method without a material file, path names a normal map, or is NULL. */
    gpointer (*open)(const char *path, GError **error);
    void (*free)(gpointer material);
    /* The constants of the shaders, as lines “#define NAME value”; may be NULL. g_free() */
    char *(*constants)(gconstpointer material, const struct method_style *style);
    gint64 (*bytes)(gconstpointer material); /* GPU memory */
    /* Gives the texels of the sample: columns and rows. NULL for a method without a material
     * file. */
    gboolean (*texels)(gconstpointer material, int ret[2]);
    /* Sets textures and uniforms of a program in use that has the shaders. */
    void (*bind)(gpointer material, guint program, const struct method_style *style);
};

extern const char *const method_rotation_names[METHOD_ROTATIONS]; /* of --rotation */

/* For methods: a table of directions; errors begin with what, "views" or "lights". */
Directions *method_directions(const struct direction_list *list, const char *what,
                              gboolean triangulated, GError **error);
/* For methods: whether a texture has room for the texels. */
gboolean method_check_size(const struct btf_layout *layout, GError **error);

extern const struct method *const methods[]; /* NULL-ended; the first is the default */

const struct method *method_find(const char *name); /* NULL: there is none */

/* argument: a file, or a session's directory, which stands for the method's product in it; may be
 * NULL if the method needs none. g_free() */
char *method_path(const struct method *method, const char *argument);

/* Calls the method's open; if the file does not exist, the error says so. Errors name the file.
 * path, for a method that needs no file: NULL, the method's name, or a normal map. */
gpointer method_open(const struct method *method, const char *path, GError **error);
