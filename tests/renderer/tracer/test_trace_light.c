/* Traced pictures of scenes whose light is known by a formula: energy, lamps, shadows, the camera.
 */
#include "base/direction.h"
#include "lib/material_fixture.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/trace_fixture.h"
#include "scene/environment_made.h"
#include "tracer/trace_path.h"

#include <gio/gio.h>
#include <math.h>
#include <png.h>
#include <string.h>

/* A diffuser and nothing else; its colour. */
#define DIFFUSER(colour)                                                                           \
    "{\"name\": \"diffuser\", \"pbrMetallicRoughness\": {\"baseColorFactor\": [" colour ", 1], "   \
    "\"metallicFactor\": 0}, \"extensions\": {\"KHR_materials_specular\": {\"specularFactor\": "   \
    "0}}}"
#define WHITE     DIFFUSER("1, 1, 1")
#define LAMP(rgb) "{\"name\": \"lamp\", \"emissiveFactor\": [" rgb "]}"

static TraceScene *read_text(const char *text) {
    g_autofree char *path = trace_fixture_write(text), *folder = g_path_get_dirname(path);
    TraceScene *scene = ok(trace_scene_read(path, ERR));
    remove_tree(folder);
    return scene;
}

static TraceScene *read_objects(const struct trace_object *objects, int n, const char *materials) {
    g_autofree char *text = trace_fixture_text(objects, n, materials, "", "", 0);
    return read_text(text);
}

/* The environment of that name, or an even one of radiance 1. */
static void set_sky(TraceScene *scene, const char *name) {
    float rgb[6] = {1, 1, 1, 1, 1, 1};
    struct environment even = {2, 1, rgb}, *made = name != NULL ? environment_make(name) : NULL;
    trace_scene_set_sky(scene, trace_sky_new(made != NULL ? made : &even, 0.0));
    environment_free(made);
}

/* Looks straight down at a small part of the plane z = 0 around (x, y), from height above. */
static void look_down(TraceScene *scene, double x, double y, double height) {
    scene->camera = (struct trace_camera){vec3(x, y, height), vec3(1, 0, 0), vec3(0, 1, 0),
                                          vec3(0, 0, 1), 0.02 / height};
}

static double mean_of(const float *values, gsize n, gsize step) {
    double sum = 0.0;
    for (gsize k = 0; k < n; k++)
        sum += (double)values[k * step];
    return sum / (double)n;
}

/* The mean of R; ret_error: its standard error. */
static double trace_mean(const TraceScene *scene, const struct trace_options *options,
                         double *ret_error) {
    g_autoptr(GError) error = NULL;
    const struct work work = {0};
    g_autoptr(TracePicture) picture = trace_render(scene, options, &work, &error);
    g_assert_no_error(error);
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    *ret_error = sqrt(mean_of(picture->variance, n, 1) / (double)n / options->samples);
    return mean_of(picture->rgb, n, 3);
}

static struct trace_options small(int side, int samples) {
    struct trace_options options = trace_options_default;
    options.width = options.height = side;
    options.samples = samples;
    return options;
}

/* A picture of two by two pixels as a data URI: red and green above, blue and grey below. */
static char *four_pixels(void) {
    static const guint8 rgb[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 188, 188, 188};
    png_image image = {
        .version = PNG_IMAGE_VERSION, .width = 2, .height = 2, .format = PNG_FORMAT_RGB};
    guint8 bytes[1024];
    png_alloc_size_t size = sizeof bytes;
    g_assert_true(png_image_write_to_memory(&image, bytes, &size, FALSE, rgb, 0, NULL) != 0);
    g_autofree char *text = g_base64_encode(bytes, size);
    return g_strconcat("data:image/png;base64,", text, NULL);
}

/* A diffuser with that picture under a lamp above it shows c/π · π = c, the product of factor and
 * pixel, where the pixels' middles are: the plane is 2 wide, its first row lies at +y. */
TEST(texture) {
    static const struct {
        double x, y;
        float rgb[3];
    } places[] = {{-0.5, 0.5, {1, 0, 0}},
                  {0.5, 0.5, {0, 1, 0}},
                  {-0.5, -0.5, {0, 0, 1}},
                  {0.5, -0.5, {0.5F, 0.5F, 0.5F}}, /* 188: 0.5029 */
                  {0, 0.5, {0.5F, 0.5F, 0}}};      /* between two */
    static const float factor[3] = {1, 0.5F, 0.25F};
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object object = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autofree char *uri = four_pixels();
    g_autofree char *more =
        g_strdup_printf(", \"textures\": [{\"source\": 0}], \"images\": [{\"uri\": \"%s\"}]", uri);
    g_autofree char *text = trace_fixture_text(
        &object, 1,
        "{\"name\": \"painted\", \"pbrMetallicRoughness\": {\"baseColorFactor\": [1, 0.5, 0.25, "
        "1], "
        "\"baseColorTexture\": {\"index\": 0}, \"metallicFactor\": 0}, \"extensions\": "
        "{\"KHR_materials_specular\": {\"specularFactor\": 0}}}",
        more, "", 0);
    g_autoptr(TraceScene) scene = read_text(text);
    const struct trace_options options = small(1, 1);
    const struct work work = {0};
    const double size = (double)plane->vertices[0].position[0];
    trace_scene_add_lamp(scene, 0.0, 0.0, 1.0);
    for (gsize k = 0; k < G_N_ELEMENTS(places); k++) {
        g_autoptr(GError) error = NULL;
        look_down(scene, places[k].x * fabs(size), places[k].y * fabs(size), 1000.0);
        scene->camera.fov_y_rad = 1e-9;
        g_autoptr(TracePicture) picture = trace_render(scene, &options, &work, &error);
        g_assert_no_error(error);
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(picture->rgb[c], places[k].rgb[c] * factor[c], 0.004);
    }
}

/* A picture that is damaged, and one that is not there: the colour only, and a warning. */
TEST(texture_unread) {
    static const char *const uris[] = {"data:image/jpeg;base64,/9j/4A==", "nowhere.png"};
    static const char *const words[] = {"the JPEG picture cannot be read", "nowhere.png"};
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object object = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    for (int k = 0; k < 2; k++) {
        g_autofree char *more = g_strdup_printf(
            ", \"textures\": [{\"source\": 0}], \"images\": [{\"uri\": \"%s\"}]", uris[k]);
        g_autofree char *text =
            trace_fixture_text(&object, 1,
                               "{\"name\": \"painted\", \"pbrMetallicRoughness\": "
                               "{\"baseColorFactor\": [0.25, 0.5, 1, "
                               "1], \"baseColorTexture\": {\"index\": 0}}}",
                               more, "", 0);
        g_autoptr(TraceScene) scene = read_text(text);
        const struct trace_surface *surface =
            &g_array_index(scene->surfaces, struct trace_surface, 0);
        g_assert_null(surface->texture);
        g_assert_nonnull(strstr(surface->warning, "“painted”"));
        g_assert_nonnull(strstr(surface->warning, words[k]));
        g_assert_cmpfloat(surface->plain.base[0], ==, 0.25);
    }
}

/* Beyond its edges a picture is repeated, mirrored or held. */
TEST(wrap) {
    static const struct {
        enum gltf_wrap wrap;
        double u, red; /* at the height of the upper row, whose pixels are red and green */
    } cases[] = {{GLTF_WRAP_REPEAT, 1.25, 1}, {GLTF_WRAP_REPEAT, -0.25, 0},
                 {GLTF_WRAP_CLAMP, 1.25, 0},  {GLTF_WRAP_CLAMP, -3, 1},
                 {GLTF_WRAP_MIRROR, 1.25, 0}, {GLTF_WRAP_MIRROR, 1.75, 1},
                 {GLTF_WRAP_MIRROR, -0.25, 1}};
    g_autofree char *uri = four_pixels();
    gsize size;
    guchar *png = g_base64_decode(strchr(uri, ',') + 1, &size);
    g_autoptr(GBytes) bytes = g_bytes_new_take(png, size);
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(GError) error = NULL;
        double rgb[3];
        TraceTexture *texture = ok(trace_texture_new(
            bytes, (const enum gltf_wrap[2]){cases[k].wrap, GLTF_WRAP_REPEAT}, ERR));
        trace_texture_colour(texture, cases[k].u, 0.75, rgb);
        g_assert_cmpfloat_with_epsilon(rgb[0], cases[k].red, 1e-6);
        g_assert_cmpfloat_with_epsilon(rgb[1], 1 - cases[k].red, 1e-6);
        trace_texture_free(texture);
    }
    g_autoptr(GError) error = NULL;
    g_autoptr(GBytes) other = g_bytes_new_static("GIF89a", 6);
    const enum gltf_wrap wrap[2] = {GLTF_WRAP_REPEAT, GLTF_WRAP_REPEAT};
    g_assert_null(trace_texture_new(other, wrap, &error));
    g_assert_nonnull(strstr(error->message, "save it as PNG or JPEG"));
}

/* 16 × 16 pixels in four squares, which Pillow wrote: quality 90, no subsampling. */
static const char four_squares[] =
    "/9j/4AAQSkZJRgABAQAAAQABAAD/2wBDAAMCAgMCAgMDAwMEAwMEBQgFBQQEBQoHBwYIDAoMDAsKCwsN"
    "DhIQDQ4RDgsLEBYQERMUFRUVDA8XGBYUGBIUFRT/2wBDAQMEBAUEBQkFBQkUDQsNFBQUFBQUFBQUFBQU"
    "FBQUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFBT/wAARCAAQABADAREAAhEBAxEB/8QA"
    "FgABAQEAAAAAAAAAAAAAAAAABwgJ/8QAFBABAAAAAAAAAAAAAAAAAAAAAP/EABgBAAMBAQAAAAAAAAAA"
    "AAAAAAcICQUG/8QAFBEBAAAAAAAAAAAAAAAAAAAAAP/aAAwDAQACEQMRAD8AFA3OqYGOkUnpS0c23ZMn"
    "Wv/Z";

/* A JPEG has the colours that were written, and one that ends early is refused. */
TEST(jpeg) {
    static const double squares[4][3] = {
        {200, 40, 40}, {40, 180, 60}, {50, 60, 210}, {240, 240, 240}};
    const enum gltf_wrap wrap[2] = {GLTF_WRAP_REPEAT, GLTF_WRAP_REPEAT};
    g_autoptr(GError) error = NULL;
    gsize size;
    g_autofree guchar *jpeg = g_base64_decode(four_squares, &size);
    g_autoptr(GBytes) bytes = g_bytes_new_static(jpeg, size);
    TraceTexture *texture = ok(trace_texture_new(bytes, wrap, ERR));
    for (int k = 0; k < 4; k++) {
        double rgb[3];
        trace_texture_colour(texture, 0.25 + 0.5 * (k % 2), k < 2 ? 0.75 : 0.25, rgb);
        for (int c = 0; c < 3; c++) {
            const double coded = squares[k][c] / 255;
            const double linear = pow((coded + 0.055) / 1.055, 2.4);
            g_assert_cmpfloat_with_epsilon(rgb[c], linear, 0.02);
        }
    }
    trace_texture_free(texture);
    g_autoptr(GBytes) less = g_bytes_new_static(jpeg, size - 20);
    g_assert_null(trace_texture_new(less, wrap, &error));
    g_assert_nonnull(strstr(error->message, "the JPEG picture cannot be read"));
}

/* Beneath an even sky of radiance 1 a white body is invisible: every pixel is 1. Convex. */
TEST(furnace__sphere) {
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object object = {sphere, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(TraceScene) scene = read_objects(&object, 1, WHITE);
    struct trace_options options = small(24, 160);
    double error;
    set_sky(scene, NULL);
    /* Inside the sphere's outline everywhere. */
    trace_scene_look(scene, 20.0, 30.0, 40.0);
    scene->camera.fov_y_rad *= 0.4;
    const double seen = trace_mean(scene, &options, &error);
    g_test_message("radiance %.5f, standard error %.5f", seen, error);
    g_assert_cmpfloat_with_epsilon(seen, 1.0, 0.005);
}

/* A white box without a lid, seen from above: light is reflected many times before it leaves, and
 * the inside is as bright as the sky nevertheless. */
TEST(furnace__box) {
    g_autoptr(Mesh) plane = scene_plane();
    struct mesh sides[5];
    struct trace_object objects[5];
    /* Of the plane −1 … 1: floor, and four walls that stand on it. */
    static const float axes[5][3][3] = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                        {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},
                                        {{0, -1, 0}, {0, 0, 1}, {-1, 0, 0}},
                                        {{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
                                        {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
    for (int k = 0; k < 5; k++) {
        sides[k] = *plane;
        sides[k].vertices = g_memdup2(plane->vertices, plane->n_vertices * sizeof(struct vertex));
        for (guint i = 0; i < plane->n_vertices; i++)
            for (int c = 0; c < 3; c++) {
                struct vertex *v = &sides[k].vertices[i];
                const float *from = plane->vertices[i].position;
                v->position[c] = from[0] * axes[k][0][c] + from[1] * axes[k][1][c];
                v->normal[c] = axes[k][2][c];
            }
        objects[k] = (struct trace_object){&sides[k], 0, 1.0F, {0, 0, 0}, FALSE};
        for (int c = 0; c < 3; c++)
            objects[k].move[c] = -axes[k][2][c];
    }
    g_autoptr(TraceScene) scene = read_objects(objects, 5, WHITE);
    struct trace_options options = small(12, 640);
    double error;
    options.depth = TRACE_MAX_DEPTH;
    set_sky(scene, NULL);
    scene->camera =
        (struct trace_camera){vec3(0, 0, 4), vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1), 0.3};
    const double seen = trace_mean(scene, &options, &error);
    g_assert_cmpfloat(error, <, 0.0012);
    g_test_message("radiance %.5f, standard error %.5f", seen, error);
    g_assert_cmpfloat_with_epsilon(seen, 1.0, 0.005);
    for (int k = 0; k < 5; k++)
        g_free(sides[k].vertices);
}

/* Captured white, as Ward's formula has it and as a table of directions; the library's own value of
 * what the sky sends, by the midpoint rule, is 1 for the formula, and little less where values are
 * interpolated between measured lights. */
TEST(furnace__captured) {
    static const char *const forms[] = {"ward", "eigenmaps"};
    enum { STEPS = 400 };
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "white.exr", NULL);
    g_autoptr(BtfMatrix) btf =
        btf_fixture_of("white", MATERIAL_WIDTH, MATERIAL_HEIGHT, btf_fixture_rings(4, 75, 0),
                       btf_fixture_rings(9, 84, 0));
    g_autofree float *lights = direction_list_vectors(&btf->layout.lights);
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object object = {sphere, 0, 1.0F, {0, 0, 0}, FALSE};
    for (gsize i = 0; i < btf_layout_texels(&btf->layout) * btf_layout_values(&btf->layout); i++)
        btf->values[i] = lights[i / 3 % btf->layout.lights.n * 3 + 2];
    for (gsize k = 0; k < G_N_ELEMENTS(forms); k++) {
        g_autoptr(TraceScene) scene = read_objects(&object, 1, WHITE);
        g_autoptr(GError) failed = NULL;
        struct trace_options options = small(24, 160);
        const float uv[2] = {0.3F, 0.7F}, view[3] = {0.6F, 0, 0.8F};
        double error, sky = 0;
        material_fixture_write(path, codecs_find(forms[k]), btf, "");
        g_assert_true(trace_scene_set_material(scene, "diffuser", path, 1, &failed));
        g_assert_no_error(failed);
        mesorig_material *material = mesorig_material_open(path, NULL, NULL);
        for (int i = 0; i < STEPS * STEPS; i++) { /* equal solid angles */
            const double z = (i / STEPS + 0.5) / STEPS, phi = 2 * G_PI * (i % STEPS + 0.5) / STEPS;
            const float light[3] = {(float)(sqrt(1 - z * z) * cos(phi)),
                                    (float)(sqrt(1 - z * z) * sin(phi)), (float)z};
            float rgb[3];
            mesorig_material_evaluate(material, 1, uv, view, light, NULL, rgb);
            sky += 2 * (double)rgb[1] / (STEPS * STEPS);
        }
        mesorig_material_close(material);
        set_sky(scene, NULL);
        trace_scene_look(scene, 20.0, 30.0, 40.0);
        scene->camera.fov_y_rad *= 0.4;
        const double seen = trace_mean(scene, &options, &error);
        g_test_message("%s: radiance %.5f, standard error %.5f; by the library %.5f", forms[k],
                       seen, error, sky);
        g_assert_cmpfloat_with_epsilon(seen, sky, 0.005);
        g_assert_cmpfloat_with_epsilon(seen, 1.0, 0.005);
    }
}

/* A plane of albedo 0.5 under lamps whose light is known, with every way to draw directions. */
TEST(plane) {
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object object = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(TraceScene) scene = read_objects(&object, 1, DIFFUSER("0.5, 0.5, 0.5"));
    struct trace_options options = small(16, 64);
    double error;
    look_down(scene, 0.2, 0.1, 2.0);
    /* Brightness 2 from 60°: 2 · cos 60° · 0.5. */
    trace_scene_add_lamp(scene, 60.0, 10.0, 2.0);
    g_assert_cmpfloat_with_epsilon(trace_mean(scene, &options, &error), 0.5, 1e-5);
    trace_scene_add_lamp(scene, 120.0, 10.0, 2.0); /* from below: nothing */
    g_assert_cmpfloat_with_epsilon(trace_mean(scene, &options, &error), 0.5, 1e-5);
    g_array_set_size(scene->lamps, 0);
    /* The overcast sky gives a white diffuser that faces the zenith the radiance 1. */
    set_sky(scene, "overcast");
    for (int way = 0; way < 4; way++) {
        options.drawing = way & 1 ? TRACE_DRAW_EVENLY : TRACE_DRAW_BY_IMPORTANCE;
        options.lamps_too = way < 2;
        const double seen = trace_mean(scene, &options, &error);
        g_assert_cmpfloat(error, <, 0.004);
        g_assert_cmpfloat_with_epsilon(seen, 0.5, 4.0 * error + 1e-4);
    }
}

/* A rectangle 2a × 2b that faces a point at distance h below its middle: the irradiance per
 * radiance is 4 · (a' atan (b' / √(1 + a'²)) / √(1 + a'²) + …) / 2 with a' = a / h (the form factor
 * of parallel rectangles' corner, four times). */
static double rectangle_form_factor(double a, double b, double h) {
    const double x = a / h, y = b / h, p = sqrt(1 + x * x), q = sqrt(1 + y * y);
    return 4.0 / (2.0 * G_PI) * (x / p * atan(y / p) + y / q * atan(x / q));
}

static struct mesh turned_over(const struct mesh *plane) {
    struct mesh over = *plane;
    over.vertices = g_memdup2(plane->vertices, plane->n_vertices * sizeof(struct vertex));
    for (guint k = 0; k < plane->n_vertices; k++) {
        over.vertices[k].position[1] = -over.vertices[k].position[1];
        over.vertices[k].normal[2] = -1.0F;
    }
    return over;
}

/* Light from an area, with a body below it that throws a shadow, or none. */
TEST(area) {
    g_autoptr(Mesh) plane = scene_plane();
    struct mesh over = turned_over(plane);
    const struct trace_object objects[] = {{plane, 0, 3.0F, {0, 0, 0}, FALSE},
                                           {&over, 1, 0.5F, {0, 0, 1.5F}, TRUE},
                                           {plane, 2, 0.2F, {2, 0, 1.0F}, TRUE}};
    const char *const materials =
        DIFFUSER("0.8, 0.4, 0.2") "," LAMP("1, 0.5, 0.25") "," DIFFUSER("0, 0, 0");
    g_autoptr(TraceScene) scene = read_objects(objects, 3, materials);
    const double truth = 0.8 * rectangle_form_factor(0.5, 0.5, 1.5);
    struct trace_options options = small(12, 256);
    double error;
    options.depth = 1; /* the floor's light on the lamp is not in the formula */
    g_assert_cmpuint(scene->areas->len, ==, 2);
    look_down(scene, 0.0, 0.0, 1.0);
    for (int way = 0; way < 2; way++) {
        options.lamps_too = way == 0;
        const double seen = trace_mean(scene, &options, &error);
        g_assert_cmpfloat(error, <, 0.005);
        g_assert_cmpfloat_with_epsilon(seen, truth, 4.0 * error);
    }
    /* The lamp's back is dark, its front is as bright as it says. */
    options.lamps_too = TRUE;
    look_down(scene, 0.0, 0.0, 4.0);
    g_assert_cmpfloat(trace_mean(scene, &options, &error), <, 1e-6);
    scene->camera.eye = vec3(0, 0, 1);
    scene->camera.back = vec3(0, 0, -1);
    g_assert_cmpfloat_with_epsilon(trace_mean(scene, &options, &error), 1.0, 1e-6);
    g_free(over.vertices);
}

/* glTF's lamps and camera: a point and a spot above a white plane; the camera's right is +x of the
 * node and its up +y, where a shadow lies. */
TEST(punctual) {
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object objects[] = {{plane, 0, 4.0F, {0, 0, 0}, FALSE},
                                           {plane, 1, 0.5F, {1, 1, 1}, FALSE}};
    static const char lamps[] =
        ", \"cameras\": [{\"type\": \"perspective\", \"perspective\": {\"yfov\": 0.8, \"znear\": "
        "0.1}}], \"extensionsUsed\": [\"KHR_lights_punctual\"], \"extensionsRequired\": "
        "[\"KHR_lights_punctual\"], \"extensions\": {\"KHR_lights_punctual\": {\"lights\": ["
        "{\"type\": \"point\", \"intensity\": 8, \"color\": [1, 0.5, 0]}, "
        "{\"type\": \"spot\", \"intensity\": 8, \"spot\": {\"innerConeAngle\": 0.2, "
        "\"outerConeAngle\": 0.4}}, {\"type\": \"directional\", \"intensity\": 3}]}}";
    static const char *const nodes[] = {
        ", {\"translation\": [-1, 2, 0], \"extensions\": {\"KHR_lights_punctual\": {\"light\": "
        "0}}}",
        ", {\"translation\": [-1, 2, 0], \"rotation\": [-0.70710678, 0, 0, 0.70710678], "
        "\"extensions\": {\"KHR_lights_punctual\": {\"light\": 1}}}",
        ", {\"rotation\": [-0.70710678, 0, 0, 0.70710678], "
        "\"extensions\": {\"KHR_lights_punctual\": {\"light\": 2}}}"};
    static const char camera[] =
        ", {\"camera\": 0, \"translation\": [0, 6, 0], \"rotation\": [-0.70710678, 0, 0, "
        "0.70710678]}";
    struct trace_options options = small(8, 4);
    options.depth = 1;
    for (int k = 0; k < 3; k++) {
        g_autofree char *both = g_strconcat(nodes[k], camera, NULL);
        g_autofree char *text =
            trace_fixture_text(objects, 2, WHITE "," DIFFUSER("0, 0, 0"), lamps, both, 2);
        g_autoptr(TraceScene) scene = read_text(text);
        double error;
        g_assert_cmpuint(scene->lamps->len, ==, 1);
        g_assert_cmpfloat_with_epsilon(scene->camera.eye.z, 6.0, 1e-6);
        g_assert_cmpfloat_with_epsilon(scene->camera.up.y, 1.0, 1e-6);
        if (k == 2) {
            /* The file's camera: the black plane is up on the right, over its shadow. */
            const struct work work = {0};
            g_autoptr(TracePicture) picture = trace_render(scene, &options, &work, NULL);
            for (int i = 0; i < 4; i++) {
                const int x = i % 2 ? 5 : 2, y = i / 2 ? 5 : 2;
                g_assert_cmpfloat_with_epsilon(picture->rgb[3 * (8 * y + x)],
                                               x == 5 && y == 2 ? 0.0 : 3.0 / G_PI, 1e-4);
            }
            scene->camera.eye = vec3(1, 1, 0.5);
            g_assert_cmpfloat(trace_mean(scene, &options, &error), ==, 0.0);
            continue;
        }
        /* Below the lamp: I / (π h²); 1 to its side: I cos³ θ / (π h²); the spot does not reach so
         * far. */
        look_down(scene, -1.0, 0.0, 0.5);
        g_assert_cmpfloat_with_epsilon(trace_mean(scene, &options, &error), 8.0 / 4.0 / G_PI, 2e-4);
        look_down(scene, -1.0, -1.0, 0.5);
        /* I cos θ / (π d²) with d = h / cos θ */
        const double aside = k == 0 ? 8.0 / 4.0 / G_PI * pow(2.0 / sqrt(5.0), 3.0) : 0.0;
        g_assert_cmpfloat_with_epsilon(trace_mean(scene, &options, &error), aside, 1e-3);
    }
}

/* A captured material on the plane: its value at that point, with the texture's first row at y = 1,
 * for the directions of eye and lamp in the plane's frame. */
TEST(captured) {
    static const double points[][2] = {{0.31, 0.17}, {-0.62, 0.55}, {0.05, -0.83}};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object object = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(TraceScene) scene = read_objects(&object, 1, WHITE);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    struct trace_options options = small(2, 1);
    double least = G_MAXDOUBLE, most = 0.0;
    material_fixture_write(path, codecs_find("lpca"), btf, "clusters=3 components=4");
    mesorig_material *material = mesorig_material_open(path, NULL, NULL);
    g_assert_true(ok(trace_scene_set_material(scene, "diffuser", path, 2.5, ERR)));
    trace_scene_add_lamp(scene, 50.0, 200.0, 3.0);
    options.depth = 1;
    for (int k = 0; k < 9; k++) {
        const double x = points[k % 3][0], y = points[k % 3][1];
        float view[3], light[3], rgb[3];
        const float uv[2] = {(float)(2.5 * (x + 1) / 2), (float)(-2.5 * (y + 1) / 2)};
        direction_from_deg(35.0, 120.0 * k / 3, view);
        direction_from_deg(50.0, 200.0, light);
        const struct vec3 back = vec3((double)view[0], (double)view[1], (double)view[2]);
        const struct vec3 right = vec3_unit(vec3_cross(vec3(0, 0, 1), back));
        scene->camera = (struct trace_camera){vec3_add(vec3(x, y, 0), vec3_scale(back, 5.0)), right,
                                              vec3_cross(back, right), back, 1e-6};
        const struct work work = {0};
        g_autoptr(TracePicture) picture = trace_render(scene, &options, &work, NULL);
        g_assert_cmpint(mesorig_material_evaluate(material, 1, uv, view, light, NULL, rgb), ==,
                        MESORIG_OK);
        for (int c = 0; c < 3; c++) {
            g_assert_cmpfloat_with_epsilon(picture->rgb[c], 3.0F * rgb[c], 1e-4F + 1e-3F * rgb[c]);
            least = fmin(least, (double)rgb[c]);
            most = fmax(most, (double)rgb[c]);
        }
    }
    g_assert_cmpfloat(most, >, 1.5 * least); /* or it would not matter where */
    mesorig_material_close(material);
}

/* The same with any number of threads; another with another seed. */
TEST(same) {
    g_autoptr(Mesh) knot = scene_shape("torus-knot", SCENE_Z_UP, NULL);
    const struct trace_object object = {knot, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(TraceScene) scene = read_objects(&object, 1, DIFFUSER("0.7, 0.6, 0.5"));
    struct trace_options options = small(40, 3);
    const struct work one = {.n_threads = 1}, three = {.n_threads = 3};
    set_sky(scene, "studio");
    g_autoptr(TracePicture) a = trace_render(scene, &options, &one, NULL);
    g_autoptr(TracePicture) b = trace_render(scene, &options, &three, NULL);
    options.seed = 2;
    g_autoptr(TracePicture) c = trace_render(scene, &options, &three, NULL);
    g_assert_cmpmem(a->rgb, 3 * 1600 * sizeof(float), b->rgb, 3 * 1600 * sizeof(float));
    g_assert_cmpmem(a->variance, 1600 * sizeof(float), b->variance, 1600 * sizeof(float));
    g_assert_cmpfloat(mean_of(a->rgb, 4800, 1), !=, mean_of(c->rgb, 4800, 1));
}

TEST(cancelled) {
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object object = {plane, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(TraceScene) scene = read_objects(&object, 1, WHITE);
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    g_autoptr(GError) error = NULL;
    const struct work work = {.cancellable = cancellable};
    const struct trace_options options = small(64, 1);
    g_cancellable_cancel(cancellable);
    g_assert_null(trace_render(scene, &options, &work, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

/* An MDF of views that are those of a BTF: everywhere depth_mm below the reference plane. */
static void write_even_mdf(const char *path, const struct btf_matrix *btf, double depth_mm) {
    g_autoptr(ExrFile) file = exr_file_new();
    for (gsize v = 0; v < btf->layout.views.n; v++) {
        const double theta_deg = (double)btf->layout.views.theta_deg[v];
        struct exr_part *part =
            mdf_file_add_view(file, (int)v, MATERIAL_WIDTH, MATERIAL_HEIGHT, theta_deg,
                              (double)btf->layout.views.phi_deg[v], btf->layout.texel_mm);
        for (int k = 0; k < MATERIAL_WIDTH * MATERIAL_HEIGHT; k++)
            part->planes[0][k] = (float)(depth_mm / cos(theta_deg * G_PI / 180.0));
    }
    g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
}

/* How far from the middle of a sphere of radius 1 level rays across its equator hit it. */
static double outline_radius(const TraceScene *scene) {
    double hits = 0.5, misses = 1.5;
    for (int k = 0; k < 30; k++) {
        const double at = (hits + misses) / 2.0;
        const struct vec3 from = vec3(at, -5.0, 1e-4);
        struct trace_hit hit;
        const gboolean met = trace_scene_hit(scene, from, vec3(0, 1, 0), &hit);
        g_assert_cmpint(trace_scene_is_free(scene, from, vec3(0, 1, 0), INFINITY), ==, !met);
        *(met ? &hits : &misses) = at;
    }
    return hits;
}

/* The surface of the material of a sphere of radius 1 is a sphere of radius 1 − d. The shell of its
 * MDF has four layers, and its opacity rises over half a layer. */
TEST(relief) {
    static const double depths[] = {0.03, 0.08};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object object = {sphere, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autoptr(GError) error = NULL;
    btf->layout.texel_mm = 0.5;
    const double tile_mm = 0.5 * sqrt(MATERIAL_WIDTH * MATERIAL_HEIGHT); /* mean of both sides */
    material_fixture_write(path, codecs_find("lpca"), btf, "clusters=3 components=4");
    for (gsize k = 0; k < G_N_ELEMENTS(depths); k++) {
        g_autofree char *mdf = g_strdup_printf("%s/mdf%zu.exr", folder, k);
        g_autoptr(TraceScene) scene = read_objects(&object, 1, WHITE);
        g_assert_true(trace_scene_set_material(scene, "diffuser", path, 1.0, &error));
        g_assert_cmpfloat_with_epsilon(outline_radius(scene), 1.0, 2e-3);
        g_assert_false(trace_scene_set_relief(scene, "diffuser", NULL, &error));
        g_assert_nonnull(strstr(error->message, "distances (MDF)"));
        g_clear_error(&error);
        g_assert_false(trace_scene_set_relief(scene, "nothing", mdf, &error));
        g_assert_nonnull(strstr(error->message, "nothing"));
        g_clear_error(&error);
        /* A unit of the sphere's coordinates, a tile, is 2 π along the equator and π across. */
        write_even_mdf(mdf, btf, depths[k] * tile_mm / (sqrt(2.0) * G_PI));
        g_assert_true(ok(trace_scene_set_relief(scene, "diffuser", mdf, ERR)));
        const double radius = outline_radius(scene);
        g_test_message("outline at %.4f, formula %.4f", radius, 1.0 - depths[k]);
        g_assert_cmpfloat_with_epsilon(radius, 1.0 - depths[k], depths[k] / 16.0);
    }
}
