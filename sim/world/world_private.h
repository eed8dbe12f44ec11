/* World and the functions of this header are private to world*.c and truth.c. */
#pragma once

#include "optics.h"
#include "samples/sample.h"
#include "world.h"
#include "world_cache.h"

#include <embree3/rtcore.h>
#include <string.h>

#define NO_TRIANGLE G_MAXUINT32

struct lamp_power { /* guarded by the world's lock */
    gboolean on, dead;
    /* `on_us`: time at which the lamp was last switched on. `off_us`: time at which it was last
     * switched off. */
    gint64 on_us, off_us;
};

#define WORLD_TURNS 128

/* The motion of the turntable from the time from_us on, until the next struct turn. */
struct turn {
    gint64 from_us;
    double deg, deg_s;
};

/* The sample's surface for light transport. Interreflection is computed between the vertices of the
 * surface. Each vertex has a list of the vertices that it sees along cosine-weighted rays. */
struct scene {
    RTCDevice device;
    RTCScene scene;
    const struct vertex *vertices;
    const guint32 (*triangles)[3];
    guint n_vertices, n_triangles;
    int n_gather;
    /* For each vertex, n_gather elements, one for each ray from this vertex. An element is the
     * vertex nearest to the point that the ray hits. It is NO_TRIANGLE if the ray hits no front
     * side. */
    guint32 *gather;
    float low[3], high[3];
    float table_albedo, table_radius_mm;
};

struct World {
    gint ref_count; /* guarded by the registry's lock */
    char *key;
    struct mesh *mesh;
    struct scene scene;
    struct optics_arc arc;
    struct optics_swing arm, probe;
    struct optics_camera cameras[WORLD_MAX_CAMERAS];
    struct optics_lamp lamps[WORLD_MAX_LAMPS];
    struct optics_laser lasers[WORLD_MAX_LASERS];
    char *camera_serials[WORLD_MAX_CAMERAS];
    char *camera_names[WORLD_MAX_CAMERAS], *lamp_names[WORLD_MAX_LAMPS],
        *laser_names[WORLD_MAX_LASERS];
    int n_cameras, n_lamps, n_lasers;
    /* TRUE if the lamp or laser is not on the arc. */
    gboolean lamp_fixed[WORLD_MAX_LAMPS], laser_fixed[WORLD_MAX_LASERS];
    gboolean camera_on_arm[WORLD_MAX_CAMERAS], lamp_on_probe[WORLD_MAX_LAMPS];
    int supersample;
    gboolean noise;
    guint64 noise_seed;
    double warm_up_s, warm_up_start, drift, drift_period_s;
    double wobble; /* tilt of the turntable's axis, rad */
    int wobble_per_turn;
    double flicker, speckle_contrast, bleeding_share;
    struct bleeding *bleeding; /* NULL if bleeding_share is 0 */
    Cache *cache;

    GMutex lock;                    /* guards the following members */
    struct turn turns[WORLD_TURNS]; /* ring buffer of the last turns */
    guint n_turns;                  /* at least 1 */
    double arc_deg, arm_deg, probe_deg, sweep_deg[WORLD_MAX_LASERS];
    struct lamp_power power[WORLD_MAX_LAMPS];
    gboolean laser_on[WORLD_MAX_LASERS];
    /* place at which each laser is mounted: the index of the laser that the file puts at this
     * place */
    int laser_place[WORLD_MAX_LASERS];
};

/* world_load.c: fills a zeroed world from its file. Returns FALSE with an error if the file is
 * wrong. The world may then be partly filled. */
gboolean world_load(World *world, const char *path, GError **error);

/* world_scene.c */
struct surface { /* point of the sample or the turntable that a ray meets; sample frame, mm */
    float p[3], n[3], t[3], ng[3]; /* normals face the viewer */
    float albedo[3], gloss, along, across;
    guint32 triangle; /* NO_TRIANGLE for the turntable */
    float u, v;
};

/* Builds a scene from a mesh. The caller must already have set n_gather, table_albedo and
 * table_radius_mm. */
void scene_init(struct scene *scene, const struct mesh *mesh, int seed);
void scene_clear(struct scene *scene);

/* Finds the first surface along each of n rays. directions are unit vectors. All positions and
 * directions are in the sample frame. If starts_mm is NULL, all rays start at eye_mm. ret_hit[i] is
 * FALSE if ray i meets no surface. */
void scene_trace(const struct scene *scene, struct v3 eye_mm, const struct v3 *starts_mm,
                 const struct v3 *directions, int n, struct surface *ret, gboolean *ret_hit);

/* Finds which surface points see a light. ret_blocked[i] is TRUE if point i does not see the light.
 * The sample then hides the light, or the light is behind the surface. n is at most SCENE_BATCH. */
#define SCENE_BATCH 256
void scene_shadow(const struct scene *scene, struct v3 light_mm, const struct surface *points,
                  int n, guint8 *ret_blocked);

/* Sets ret to at most SCENE_BATCH vertices of the scene, from first on, and returns their number.
 * ret_blocked says for each vertex whether a light is hidden from it. In ret, the albedo is chosen
 * so that scene_reflect() returns n·l for green. */
int scene_light_vertices(const struct scene *scene, guint first, struct v3 light_mm,
                         struct surface *ret, guint8 *ret_blocked);

/* Returns the corner of a triangle that is nearest to the point with the barycentric coordinates
 * (u, v). */
guint32 scene_nearest_vertex(const struct scene *scene, guint32 triangle, float u, float v);

/* Returns n·l·(diffuse + gloss) for light from light_mm, seen from eye_mm. To get the radiance,
 * multiply by the irradiance E_⊥ on a surface that faces the light. */
float scene_reflect(const struct surface *s, struct v3 light_mm, struct v3 eye_mm,
                    enum cfa_colour colour);

/* world_light.c */

/* Returns the bits of a number, for keys of the cache. */
static inline guint64 world_bits(double value) {
    guint64 word;
    memcpy(&word, &value, sizeof word);
    return word;
}

/* Returns the angle between arc and turntable. It is rounded, so that angles give the same picture
 * if they differ by full turns or by less than 1e-9 degrees. */
double world_relative_rad(double arc_deg, double turntable_deg);

/* Returns the part of a cache's key that stands for the position of the arm or probe. It is 0 if
 * the device is not carried by the arm or probe. */
guint64 world_carried_bits(gboolean carried, double deg);

/* The pose of a light, seen from the sample. Results for a fixed light depend only on the angle of
 * the turntable. Results for a light on the arc depend only on the angle between arc and turntable,
 * if their axes are the same and the turntable does not wobble. */
struct light_pose {
    double relative_rad;  /* world_relative_rad() */
    double turntable_rad; /* 0 if the turntable's angle has no effect */
    gboolean fixed;
    double probe_deg; /* angle of the probe if the probe carries the lamp, otherwise 0 */
    /* TRUE if the frame of the pose does not tilt with the turntable. When the turntable is at 0°,
     * this frame is the rig frame. */
    gboolean upright;
};
struct light_pose world_light_pose(const World *world, gboolean fixed, double arc_deg,
                                   double turntable_deg);
struct light_pose world_lamp_pose(const World *world, int lamp, double arc_deg, double probe_deg,
                                  double turntable_deg);
struct optics_lamp world_lamp_at(const World *world, int lamp, struct light_pose pose);
struct optics_laser world_laser_at(const World *world, int laser, struct light_pose pose);

/* Returns the pose of a camera with the arm at an angle. */
struct optics_camera world_camera_at(const World *world, int camera, double arm_deg);
struct v3 world_eye_mm(const World *world, const struct optics_camera *camera,
                       double turntable_deg);

/* Converts from the sample frame, with the turntable at an angle, to the rig frame. */
struct v3 world_to_rig(const World *world, double turntable_deg, struct v3 p);

/* A point of the surface that a pixel shows. Points are packed, because a view has several points
 * per pixel, and a session has many views. Directions are points of a folded octahedron
 * (world_point.c), and numbers from 0 to 1 are integers. The rounding errors are far below a
 * sensor's noise. */
struct point {
    float p[3];
    gint16 n[2], t[2], ng[2];
    guint16 albedo; /* albedo for the pixel's colour */
    guint16 gloss, along, across, u, v;
    guint32 triangle, pixel;
};

/* The surface points that a camera sees at given angles of arm and turntable. A pixel that shows
 * neither sample nor turntable has no points. A pixel that shows only the turntable has one
 * point. */
struct view {
    struct v3 eye_mm;
    /* For each pixel, the weight of each of its points, in DN·s⁻¹ per W·sr⁻¹·m⁻². The weight
     * includes the share of the pixel's area that the point represents. */
    const float *weights;
    guint n;
    struct point points[];
};

/* Returns the view of a camera (struct view). magnification is that of the light, relative to green
 * light. If it is 0, the light is white, and each pixel has the magnification of its filter's
 * colour. */
struct cache_entry *world_view(World *world, int camera, double arm_deg, double turntable_deg,
                               double magnification);

/* world_point.c: packs a surface into a point, and unpacks it. A point has only the albedo for the
 * pixel's colour. After unpacking, all three colours have this albedo. */
void world_pack(const struct surface *from, enum cfa_colour colour, guint32 pixel,
                struct point *ret);
void world_unpack(const struct point *from, struct surface *ret);

/* Sets ret to at most SCENE_BATCH points of a view, from first on, and returns their number.
 * ret_blocked says for each point whether a light is hidden from it. */
int world_light_points(const World *world, const struct view *view, guint first, struct v3 light_mm,
                       struct surface *ret, guint8 *ret_blocked);

/* Returns the colour of the filter in front of a pixel. Pixels are counted row by row. */
static inline enum cfa_colour world_pixel_colour(const struct optics_camera *camera,
                                                 guint32 pixel) {
    guint32 width = (guint32)camera->width;
    return cfa_colour_at(camera->cfa, (int)(pixel % width), (int)(pixel / width));
}

/* Returns the irradiance at each vertex after one bounce, as R G B, for a lamp at full output. */
struct cache_entry *world_bounce(World *world, int lamp, struct light_pose pose);

/* Returns the light after one bounce at a point of a triangle, interpolated between its corners. */
float world_bounce_at(const World *world, const float *bounce, const struct surface *s,
                      enum cfa_colour colour);

/* Returns a picture in DN·s⁻¹, width × height, for a lamp at full output. */
struct cache_entry *world_lamp_picture(World *world, int camera, int lamp,
                                       const struct world_state *state);

/* world_laser.c: adds the light of a laser to a picture, in DN·s⁻¹. */
void world_add_laser(World *world, int camera, int laser, const struct world_state *state,
                     float *rate);

/* world_speckle.c: adds speckle to a picture of the light of one laser, in DN·s⁻¹. */
void world_speckle(const World *world, int camera, int laser, const struct world_state *state,
                   float *rate);

/* world_bleeding.c: laser light that enters the sample and comes out elsewhere. The upper side of
 * the sample, seen from above, is cut into the cells of a grid. A share of the light on a cell
 * spreads to other cells, in proportion to exp(−r/scale). r is the distance in space. The turntable
 * takes no part. Surfaces that are hidden from above, such as the lower side of a thread, take no
 * part either. */
struct bleeding;
struct bleeding *bleeding_new(const struct scene *scene, double scale_mm);
void bleeding_free(struct bleeding *bleeding); /* NULL is ignored */

/* Adds the light that comes out, multiplied by bleeding_share, to a picture in DN·s⁻¹. */
void world_add_bleeding(World *world, int camera, int laser, struct light_pose pose, double sweep,
                        const struct view *view, float *rate);
