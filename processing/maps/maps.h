/*
 * Maps for artists: a microfacet model of each texel (maps_model.h) fitted to a whole BTF
 * (maps_fit.h), with heights and ambient occlusion, as maps, glTF 2.0, MaterialX, and a script for
 * Blender. Any thread; nothing is written before all is computed.
 */
#pragma once

#include "base/work.h"
#include "maps_files.h"
#include "maps_fit.h"

#define MAPS_MOST_TEXELS (4096 * 4096)

enum maps_heights { MAPS_HEIGHTS_MDF, MAPS_HEIGHTS_NORMALS };

/* What became of the fit: it is not kept, it is kept for the next export, or it is that of an
 * earlier export. */
enum maps_kept { MAPS_FIT_UNKEPT, MAPS_FIT_KEPT, MAPS_FIT_TAKEN };

/* The difference between the maps, rounded as 8 bits hold them, and the BTF they were fitted to. */
struct maps_errors {
    int n_views, n_lights;
    double delta_e;        /* mean CIEDE2000, white being the diffuser */
    double relative_error; /* ‖A − Â‖ / ‖A‖ of R, G and B */
    float *pairs;          /* n_views × n_lights: the mean over texels; NaN: none was compared */
    float *texels;         /* height × width: the mean over pairs */
    int every;             /* of a texel, each every-th pair was compared: 1: all */
};

struct maps {
    char *name; /* of the session, made of letters, digits, "-" and "_" */
    int width, height;
    double texel_mm;
    int n_views, n_lights;
    gint64 holes; /* values of the BTF that were not measured, and come from texels around them */
    double depth_mm; /* of the mean surface, which the maps describe, below the reference plane */
    struct maps_fit *fit;
    enum maps_heights heights_from;
    float *heights_mm;   /* height × width, from 0 upwards */
    double relief_mm;    /* the largest height */
    int height_holes;    /* texels without a height, which got that of texels around */
    float *occlusion;    /* height × width: 1: none */
    float most_specular; /* the largest specular_colour, at least 1 */
    enum maps_model model;
    gboolean anisotropic; /* the anisotropy of some texels matters */
    struct maps_errors errors;
    enum maps_kept kept;
    char *lost; /* why the fit of a session could not be kept; NULL: it is, or it is no session's */
};

/* path: a session or its products/btf. model: what the fit may use; a fit of each is kept. memory:
 * bytes for the BTF, of which the rest is kept in a file; 0: any. The fit is kept in the session
 * (maps_store.h) and, while the BTF is the same, taken from there. Stages "read", "depth",
 * "layers", "fit", "errors", which are left out then, and "occlusion".
 */
struct maps *maps_new(const char *path, enum maps_model model, gint64 memory,
                      const struct work *work, GError **error);
/* Without a session: of a BTF, with heights from normals. */
struct maps *maps_new_of(const struct btf_matrix *btf, enum maps_model model,
                         const struct work *work, GError **error);
void maps_free(struct maps *maps); /* NULL is ignored */
typedef struct maps Maps;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Maps, maps_free)

/*
 * The maps, as NAME_BaseColor, _Metallic, _Roughness, _SpecularLevel, _SpecularEdge,
 * _SpecularColor, _Normal (OpenGL's: green upwards), _Height, _AmbientOcclusion, _AnisotropyLevel,
 * _AnisotropyAngle, and where there is a layer, _SheenColor or _ClearCoat; PNG, of 8 bits, heights
 * and normals of 16; or EXR, linear. Here roughness is √(αt αb)^½, the level 1 − αb / αt, as
 * Blender and standard_surface have them, and the angle that of t from +x counter-clockwise, 1
 * being a whole turn. SpecularLevel is half of specular · specular_colour, so that 0.5 is a
 * reflectance of 4 %, and SpecularEdge what is reached towards grazing directions, 1 being all.
 * Heights are 0 … 1 of relief_mm, in EXR mm. And NAME_errors.csv, NAME_errors_directions.png and
 * NAME_errors_texels.png.
 */
gboolean maps_add_maps(const struct maps *maps, gboolean exr, MapsFiles *files, GError **error);
/* The errors: a table of views and lights, and the same as pictures: a row a view, a column a
 * light; and of the texels. Black is 0, white 10 or more. */
gboolean maps_add_errors(const struct maps *maps, MapsFiles *files, GError **error);

enum maps_shapes { MAPS_PLANE = 1, MAPS_SPHERE = 2 };
/* A binary glTF, or, if text, a .gltf with the files that it names. shapes: a sum. Metres, y up;
 * extensions are used where a map needs them; a material of the core model has none, and no
 * occlusion, which some renderers multiply direct light with. file: the name of the first file. */
gboolean maps_add_gltf(const struct maps *maps, const char *file, gboolean text, int shapes,
                       MapsFiles *files, GError **error);
/* NAME_openpbr.mtlx and NAME_standard_surface.mtlx, and the maps. */
gboolean maps_add_materialx(const struct maps *maps, MapsFiles *files, GError **error);
/* NAME_blender.py, and the maps. */
gboolean maps_add_blender(const struct maps *maps, MapsFiles *files, GError **error);

/* What 8 bits of the maps of a glTF give back of a texel. */
struct maps_texel maps_rounded(const struct maps *maps, gsize texel);
