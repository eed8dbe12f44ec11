/* Maps for artists. A microfacet model (maps_model.h) is fitted to each texel of a whole BTF
 * (maps_fit.h). The result, with heights and ambient occlusion, is exported as maps, as glTF 2.0,
 * as MaterialX, as USD, and as a script for Blender. Any thread. Nothing is written before
 * everything is computed. */
#pragma once

#include "base/work.h"
#include "maps_files.h"
#include "maps_fit.h"

#define MAPS_MAX_TEXELS (4096 * 4096)

enum maps_heights { MAPS_HEIGHTS_MDF, MAPS_HEIGHTS_NORMALS };

/* What was done with the fit:
 * MAPS_FIT_UNKEPT  the fit was made, and not stored
 * MAPS_FIT_KEPT    the fit was made, and stored for the next export
 * MAPS_FIT_TAKEN   the stored fit of an earlier export was used */
enum maps_kept { MAPS_FIT_UNKEPT, MAPS_FIT_KEPT, MAPS_FIT_TAKEN };

/* The difference between the maps, rounded to 8 bits, and the BTF to which they were fitted. */
struct maps_errors {
    int n_views, n_lights;
    double delta_e;        /* mean CIEDE2000; the white diffuser is white */
    double relative_error; /* ‖A − Â‖ / ‖A‖ of R, G and B */
    /* n_views × n_lights: mean CIEDE2000 over texels; NaN if no texel was compared */
    float *pairs;
    float *texels; /* height × width: mean CIEDE2000 over pairs */
    /* Each texel was compared at one out of this number of pairs of a view and a light. 1 means
     * that all pairs were compared. */
    int every;
};

struct maps {
    char *name; /* name of the session, reduced to letters, digits, "-" and "_" */
    int width, height;
    double texel_mm;
    int n_views, n_lights;
    /* number of values of the BTF that were not measured, and were taken from neighbouring
     * texels */
    gint64 holes;
    /* depth of the mean surface below the reference plane; the maps describe points of the mean
     * surface */
    double depth_mm;
    struct maps_fit *fit;
    enum maps_heights heights_from;
    float *heights_mm; /* height × width; the lowest is 0 */
    double relief_mm;  /* the maximum of heights_mm */
    /* number of texels without a height, which have the height of neighbouring texels */
    int height_holes;
    float *occlusion;   /* height × width; 1 means not occluded */
    float max_specular; /* maximum of specular_colour, at least 1 */
    enum maps_model model;
    /* whether the mean anisotropy is at least 0.15; if not, all texels were made isotropic */
    gboolean anisotropic;
    struct maps_errors errors;
    /* largest maps_specular_level() of the texels, at least 1 */
    float specular_scale;
    enum maps_kept kept;
    /* Why the fit of a session could not be stored. NULL if the fit is stored, or if it was not to
     * be stored: there is no session, or a file of the BTF is not among the session's products. */
    char *lost;
};

/* Makes the maps of path, a session or its products/btf. model gives the parameters that the fit
 * may use. memory is the maximum number of bytes for the values of the BTF, or 0 for no limit. A
 * larger BTF stays in a file.
 *
 * The fit is stored in the session (maps_store.h), one fit for each model. The stored fit is used
 * again as long as the BTF is the same.
 *
 * The progress stages are "read", "depth", "layers" (only for MAPS_MODEL_FULL), "fit", "refine",
 * "errors", "points" (only if the session has an MDF) and "occlusion". If a stored fit is used,
 * only "points" and "occlusion" remain. */
struct maps *maps_new(const char *path, enum maps_model model, gint64 memory,
                      const struct work *work, GError **error);
/* For tests: makes the maps of a BTF without a session. Heights are computed from normals. */
struct maps *maps_new_of(const struct btf_matrix *btf, enum maps_model model,
                         const struct work *work, GError **error);
void maps_free(struct maps *maps); /* NULL is ignored */
typedef struct maps Maps;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Maps, maps_free)

/* Returns half of specular · specular_colour, so that 0.5 is a reflectance of 4 %. */
float maps_specular_level(const struct maps_texel *texel);

/* Adds the maps as NAME_BaseColor, _Metallic, _Roughness, _SpecularLevel, _SpecularEdge,
 * _SpecularColor, _Normal (OpenGL's: green upwards), _Height, _AmbientOcclusion, _AnisotropyLevel
 * and _AnisotropyAngle. A material with a layer also has _SheenColor or _ClearCoat. The format is
 * PNG of 8 bits, with heights and normals of 16 bits, or linear EXR.
 *   Roughness         (αt αb)^¼, with αt and αb of maps_model.h
 *   AnisotropyLevel   1 − αb / αt, as in Blender and standard_surface
 *   AnisotropyAngle   angle of t from +x, counter-clockwise; 1 is a whole turn
 *   SpecularLevel     maps_specular_level(); in PNG divided by specular_scale
 *   SpecularEdge      reflectance at grazing directions; 1 is total reflection
 *   Height            in mm in EXR; in PNG a share of relief_mm, 0 … 1 */
gboolean maps_add_maps(const struct maps *maps, gboolean exr, MapsFiles *files, GError **error);
/* Adds the errors in three files:
 *   NAME_errors.csv             table of views and lights
 *   NAME_errors_directions.png  picture with a row for each view and a column for each light
 *   NAME_errors_texels.png      picture of the texels
 * In the pictures, black is a CIEDE2000 of 0, white is 10 or more, and grey means that nothing was
 * compared. */
gboolean maps_add_errors(const struct maps *maps, MapsFiles *files, GError **error);

enum maps_shapes { MAPS_PLANE = 1, MAPS_SPHERE = 2 };
/* Adds a binary glTF. If text is TRUE, adds a .gltf and the files that it names instead. file is
 * the name of the first file. shapes is a sum of enum maps_shapes. Lengths are in metres, with y
 * upwards.
 *
 * Extensions are used only if a map needs them. A material of the core model has no extensions. It
 * also has no occlusion, because some renderers apply occlusion to direct light. */
gboolean maps_add_gltf(const struct maps *maps, const char *file, gboolean text, int shapes,
                       MapsFiles *files, GError **error);
/* Adds NAME_openpbr.mtlx, NAME_standard_surface.mtlx, the maps of maps_add_maps() as PNG, and the
 * further maps NAME_OpenPBRRoughness and NAME_SpecularWeight. */
gboolean maps_add_materialx(const struct maps *maps, MapsFiles *files, GError **error);
/* Adds NAME.usda, the maps of maps_add_maps() as PNG, and the map NAME_SpecularWeight. The scene
 * has shapes as in maps_add_gltf(). The material of the scene has UsdPreviewSurface and the
 * standard_surface of MaterialX. UsdPreviewSurface has occlusion, but not in the core model. */
gboolean maps_add_usd(const struct maps *maps, int shapes, MapsFiles *files, GError **error);
/* Adds NAME_blender.py, and the maps of maps_add_maps() as PNG. */
gboolean maps_add_blender(const struct maps *maps, MapsFiles *files, GError **error);

/* Returns a texel as it is read from the 8 bits of the maps of a glTF. */
struct maps_texel maps_rounded(const struct maps *maps, gsize texel);
