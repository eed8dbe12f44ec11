/* Compressed distances, compared with closed forms and with the way in which a graphics card reads
 * them. */
#include "base/data_error.h"
#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"
#include "codecs/mdf_codecs/mdf_packed.h"
#include "exr/exr.h"
#include "lib/gpu_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/silhouettes.h"
#include "lib/test.h"
#include "lib/world_fixture.h"
#include "pipeline/pipeline.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <epoxy/gl.h>
#include <glib/gstdio.h>
#include <string.h>

#define SIDE    24
#define TEXELS  (SIDE * SIDE)
#define N_VIEWS 24
#define W       240
#define H       180

/* Something between −1 and 1 that is as unlike another texel's as can be. */
static double noise(int i, int seed) {
    return sin((12.9898 + seed) * i + (0.37 + 0.11 * seed) * i * i);
}

/* As a height field that is seen along v: its height, and how that rises, each times something of
 * v; three maps in all. */
static double exact(int view, int x) {
    const double slant = view < N_VIEWS / 2 ? 0.5 : 1.2, phi = view * G_PI / 6;
    return 3 + 0.4 * slant + (1 + 0.2 * slant) * noise(x, 1) + slant * cos(phi) * noise(x, 2) +
           slant * sin(phi) * noise(x, 3);
}

static struct mdf_table *new_table(void) {
    struct mdf_table *t = g_new0(struct mdf_table, 1);
    *t = (struct mdf_table){
        .width = SIDE,
        .height = SIDE,
        .n_views = N_VIEWS,
        .texel_mm = 0.5,
        .deepest_mm = 8,
        .theta_deg = g_new0(float, N_VIEWS),
        .phi_deg = g_new0(float, N_VIEWS),
        .depth_mm = g_new0(float, N_VIEWS *TEXELS),
        .seen = g_new0(guint8, N_VIEWS * TEXELS),
    };
    memset(t->seen, 1, N_VIEWS * TEXELS);
    for (int v = 0; v < N_VIEWS; v++) {
        t->theta_deg[v] = v < N_VIEWS / 2 ? 30 : 60;
        t->phi_deg[v] = 30 * (float)(v % (N_VIEWS / 2));
        for (int x = 0; x < TEXELS; x++)
            t->depth_mm[v * TEXELS + x] = (float)exact(v, x);
    }
    return t;
}

static struct mdf_factors *factors(const struct mdf_table *t, int terms) {
    struct mdf_factors *f = ok(mdf_factors_compute(t, t->n_views, terms, 0, NULL, ERR));
    return f;
}

static double worst(const struct mdf_factors *f) {
    g_autoptr(MdfTable) is = mdf_factors_table(f);
    double most = 0;
    for (int i = 0; i < N_VIEWS * TEXELS; i++)
        most = fmax(most, fabs(is->depth_mm[i] - exact(i / TEXELS, i % TEXELS)));
    return most;
}

/* As many maps as there are: what is left is the rounding of three of 8 bits. */
TEST(maps__enough) {
    g_autoptr(MdfTable) t = new_table();
    g_autoptr(MdfFactors) f = factors(t, 3), more = factors(t, 16), fewer = factors(t, 2);
    g_test_message("3 maps: %.4f mm RMS, at most %.4f; 2: %.4f", f->error_mm, worst(f),
                   fewer->error_mm);
    /* Each map reaches over about 4 mm: half a step of it is 0.008 mm, for each of them. */
    g_assert_cmpfloat(worst(f), <, 3 * 0.008 + 0.002);
    g_assert_cmpfloat(f->error_mm, <, 0.008);
    g_assert_cmpint(mdf_factors_bytes(f), ==, 3 * TEXELS + 4 * 4 * N_VIEWS);
    g_assert_cmpfloat(more->error_mm, <=, f->error_mm * 1.01);
    g_assert_cmpfloat(fewer->error_mm, >, 20 * f->error_mm);
}

/* Texels that were not seen count nothing, and take what the others say of them. */
TEST(maps__unseen) {
    g_autoptr(MdfTable) t = new_table();
    for (int i = 0; i < N_VIEWS * TEXELS; i++)
        if ((i * 7919) % 101 < 8) {
            t->seen[i] = 0;
            t->depth_mm[i] = (float)(3.4 + noise(i, 9)); /* as filled from around */
        }
    g_autoptr(MdfFactors) f = factors(t, 3);
    g_autoptr(MdfTable) is = mdf_factors_table(f);
    double squares = 0, before = 0;
    int n = 0;
    for (int i = 0; i < N_VIEWS * TEXELS; i++)
        if (!t->seen[i]) {
            const double should = exact(i / TEXELS, i % TEXELS);
            squares += pow(is->depth_mm[i] - should, 2);
            before += pow(t->depth_mm[i] - should, 2);
            n++;
        }
    g_test_message("%d unseen: %.3f mm, %.3f as filled; seen: %.4f", n, sqrt(squares / n),
                   sqrt(before / n), f->error_mm);
    g_assert_cmpfloat(squares, <, 0.01 * before);
    g_assert_cmpfloat(f->error_mm, <, 0.05);
}

TEST(maps__target) {
    g_autoptr(GError) none = NULL, error = NULL;
    g_autoptr(MdfTable) t = new_table();
    g_autoptr(MdfFactors) f = mdf_factors_compute(t, N_VIEWS, 16, 0.1, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(f->n_terms, ==, 3);
    g_assert_cmpfloat(f->error_mm, <=, 0.1);
    g_assert_null(mdf_factors_compute(t, N_VIEWS, 2, 0.1, NULL, &none));
    g_assert_nonnull(strstr(none->message, "not reached: with 2 maps"));
    g_autoptr(GCancellable) cancelled = g_cancellable_new();
    g_autoptr(GError) stopped = NULL;
    g_cancellable_cancel(cancelled);
    g_assert_null(mdf_factors_compute(t, N_VIEWS, 4, 0, cancelled, &stopped));
    g_assert_error(stopped, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

/* No relief; one view; and what makes no sense. */
TEST(maps__odd) {
    struct mdf_table *t = new_table();
    for (int i = 0; i < N_VIEWS * TEXELS; i++)
        t->depth_mm[i] = 2.5F;
    g_autoptr(MdfFactors) flat = factors(t, 8);
    g_assert_cmpfloat(flat->error_mm, <, 1e-5);
    g_assert_cmpint(flat->n_terms, ==, 1);
    mdf_table_free(t);
    t = new_table();
    t->n_views = 1;
    g_autoptr(MdfFactors) one = factors(t, 8);
    g_assert_cmpint(one->n_terms, ==, 1);
    g_assert_cmpfloat(one->error_mm, <, 0.008);
    static const int bad[][2] = {{0, 1}, {MDF_FACTORS_MAX_TERMS + 1, 1}, {4, 0}, {4, 2}};
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(mdf_factors_compute(t, bad[i][1], bad[i][0], 0, NULL, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    }
    mdf_table_free(t);
}

static void assert_refused(const char *path, gboolean blocks, const char *says) {
    g_autoptr(GError) error = NULL;
    if (blocks)
        g_assert_null(mdf_blocks_read(path, &error));
    else
        g_assert_null(mdf_factors_read(path, &error));
    g_assert_nonnull(error);
    if (!strstr(error->message, path) || (says && !strstr(error->message, says)))
        g_error("“%s” is not said: %s", says, error->message);
}

/* Cut off anywhere. */
static void assert_cut_refused(const char *path, gboolean blocks) {
    g_autofree char *bytes = NULL, *cut = g_strconcat(path, ".cut", NULL);
    gsize n;
    g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
    for (gsize at = 0; at < n; at += n / 7) {
        g_assert_true(g_file_set_contents(cut, bytes, (gssize)at, NULL));
        assert_refused(cut, blocks, NULL);
    }
    g_unlink(cut);
}

struct change {
    const char *part, *channel; /* a value of which becomes that */
    float value;
    const char *attribute; /* or an attribute of it */
    double number;
    const char *says;
};

static void assert_changed_refused(const char *path, gboolean blocks, const struct change *c) {
    g_autoptr(GError) error = NULL;
    g_autofree char *to = g_strconcat(path, ".changed", NULL);
    struct exr_file *file = ok(exr_read(path, ERR));
    struct exr_part *part = exr_file_part(file, c->part);
    if (c->channel)
        exr_part_plane(part, c->channel)[1] = c->value;
    else if (g_str_equal(c->attribute, "mesorig.kind"))
        exr_set_string(part, c->attribute, "something");
    else if (g_str_has_prefix(c->attribute, "mesorig.") && !strstr(c->attribute, "error"))
        exr_set_int(part, c->attribute, (int)c->number);
    else
        exr_set_double(part, c->attribute, c->number);
    g_assert_true(exr_write(to, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
    assert_refused(to, blocks, c->says);
    g_unlink(to);
}

TEST(maps__file) {
    static const struct change changes[] = {
        {"maps", "M02", 256, .says = "0 to 255"},
        {"maps", "M02", -1, .says = "0 to 255"},
        {"maps", "M01", NAN, .says = "0 to 255"},
        {"maps", "M01", 7.5F, .says = "0 to 255"},
        {"weights", "W", NAN, .says = "weight"},
        {"weights", "W", INFINITY, .says = "weight"},
        {"views", "theta_deg", 120, .says = "direction"},
        {"maps", .attribute = "mesorig.kind", .says = "is not mdf-factors"},
        {"maps", .attribute = "mesorig.measured", .number = N_VIEWS + 1, .says = "measured"},
        {"maps", .attribute = "texel_mm", .number = -1, .says = "texel_mm"},
        {"maps", .attribute = "deepest_mm", .number = NAN, .says = "deepest_mm"},
    };
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(world_fixture_folder(), "factors.exr", NULL);
    g_autoptr(MdfTable) t = new_table();
    g_autoptr(MdfFactors) f = factors(t, 5);
    g_assert_true(mdf_factors_write(path, f, &error));
    g_autoptr(MdfFactors) again = mdf_factors_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpmem(f->maps, (gsize)f->n_terms * TEXELS, again->maps,
                    (gsize)again->n_terms * TEXELS);
    g_assert_cmpmem(f->weights, sizeof(float) * N_VIEWS * (gsize)(f->n_terms + 1), again->weights,
                    sizeof(float) * N_VIEWS * (gsize)(again->n_terms + 1));
    g_assert_cmpfloat(f->error_mm, ==, again->error_mm);
    g_assert_cmpint(mdf_kind(path), ==, MDF_KIND_FACTORS);
    assert_cut_refused(path, FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++)
        assert_changed_refused(path, FALSE, &changes[i]);
}

TEST(blocks__file) {
    static const struct change changes[] = {
        {"view_0003", "B2", 256, .says = "0 to 255"},
        {"view_0003", "B7", NAN, .says = "0 to 255"},
        {"view_0000", .attribute = "mesorig.kind", .says = "is not mdf-blocks"},
        {"view_0000", .attribute = "mesorig.width", .number = SIDE + 8, .says = "mesorig.width"},
        {"view_0000", .attribute = "mesorig.height", .number = G_MAXINT, .says = "mesorig.height"},
        {"view_0000", .attribute = "least_mm", .number = 100, .says = "least_mm"},
        {"view_0005", .attribute = "view.theta_deg", .number = NAN, .says = "view.theta_deg"},
    };
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(world_fixture_folder(), "blocks.exr", NULL);
    g_autoptr(MdfTable) t = new_table();
    g_autoptr(MdfBlocks) b = mdf_blocks_new(t);
    g_assert_true(mdf_blocks_write(path, b, &error));
    g_autoptr(MdfBlocks) again = mdf_blocks_read(path, &error);
    g_assert_no_error(error);
    const gsize n = N_VIEWS * mdf_blocks_bytes(SIDE, SIDE);
    g_assert_cmpmem(b->blocks, n, again->blocks, n);
    g_assert_cmpfloat(b->error_mm, ==, again->error_mm);
    g_assert_cmpint(mdf_kind(path), ==, MDF_KIND_BLOCKS);
    assert_cut_refused(path, TRUE);
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++)
        assert_changed_refused(path, TRUE, &changes[i]);
}

/* Eight values between two ends that are whole steps come back as they are; others to half a
 * fourteenth of what the block reaches over, and a step. */
TEST(blocks__error) {
    float depth[16 * 16], is[16 * 16];
    guint8 blocks[16 * MDF_BLOCK_BYTES];
    for (int i = 0; i < 256; i++)
        depth[i] = (float)(100 + 10 * (i % 4 + 4 * (i / 16 % 2))) / 255;
    mdf_blocks_encode(depth, 16, 16, 0, 1, blocks);
    mdf_blocks_decode(blocks, 16, 16, 0, 1, is);
    for (int i = 0; i < 256; i++)
        g_assert_cmpfloat_with_epsilon(is[i], depth[i], 1e-5);
    for (int i = 0; i < 256; i++)
        depth[i] = (float)(2 + noise(i, 4));
    mdf_blocks_encode(depth, 16, 16, 0.5, 4, blocks);
    mdf_blocks_decode(blocks, 16, 16, 0.5, 4, is);
    for (int i = 0; i < 256; i++)
        g_assert_cmpfloat_with_epsilon(is[i], depth[i], 2.0 / 7 + 3.5 / 255);
    /* Not whole blocks: nothing is read or written beyond them. */
    g_autofree float *odd = g_new0(float, 5 * 3), *odd_is = g_new0(float, 5 * 3);
    g_assert_cmpuint(mdf_blocks_bytes(5, 3), ==, 2 * MDF_BLOCK_BYTES);
    for (int i = 0; i < 15; i++)
        odd[i] = (float)(i % 5);
    g_autofree guint8 *two = g_new(guint8, 2 * MDF_BLOCK_BYTES);
    mdf_blocks_encode(odd, 5, 3, 0, 4, two);
    mdf_blocks_decode(two, 5, 3, 0, 4, odd_is);
    for (int i = 0; i < 15; i++)
        g_assert_cmpfloat_with_epsilon(odd_is[i], odd[i], 0.25);
}

/* Any bytes are what the card says they are: both of the format's ways to number values. */
GPU_TEST(blocks__card) {
    guint8 blocks[16 * MDF_BLOCK_BYTES];
    float ours[256], card[256];
    GLuint texture;
    for (gsize i = 0; i < sizeof blocks; i++)
        blocks[i] = (guint8)g_test_rand_int_range(0, 256);
    mdf_blocks_decode(blocks, 16, 16, 0, 1, ours);
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glCompressedTexImage2D(GL_TEXTURE_2D, 0, GL_COMPRESSED_RED_RGTC1, 16, 16, 0, sizeof blocks,
                           blocks);
    glGetTexImage(GL_TEXTURE_2D, 0, GL_RED, GL_FLOAT, card);
    g_assert_cmpint(glGetError(), ==, GL_NO_ERROR);
    glDeleteTextures(1, &texture);
    for (int i = 0; i < 256; i++)
        g_assert_cmpfloat_with_epsilon(card[i], ours[i], 2.0 / 255); /* some cut off */
}

static void write_views(const char *path, gboolean no_distances) {
    static const char *const channels[] = {"D", "N", NULL}, *const others[] = {"N", NULL};
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_file_new();
    for (int v = 0; v < N_VIEWS; v++) {
        g_autofree char *name = g_strdup_printf("view_%04d", v);
        struct exr_part *part =
            exr_part_new(name, SIDE, SIDE, no_distances ? others : channels, EXR_FLOAT);
        for (int x = 0; x < TEXELS; x++)
            part->planes[0][x] = (x + v) % 17 ? (float)exact(v, x) : -1;
        exr_set_double(part, "view.theta_deg", v < N_VIEWS / 2 ? 30 : 60);
        exr_set_double(part, "view.phi_deg", 30 * (v % (N_VIEWS / 2)));
        exr_set_double(part, "texel_mm", 0.5);
        exr_file_add(file, part);
    }
    g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
}

TEST(packed) {
    g_autoptr(GError) error = NULL, twice = NULL, none = NULL;
    g_autofree char *from = g_build_filename(world_fixture_folder(), "views.exr", NULL);
    g_autofree char *to = g_build_filename(world_fixture_folder(), "packed.exr", NULL);
    const double most[] = {8.0 / 2048, 8.0 / 255 / 2 + 1e-6}; /* half a step of each */
    gint64 bytes;
    write_views(from, FALSE);
    g_autoptr(MdfTable) t = mdf_table_read(from, &error);
    g_assert_no_error(error);
    for (int kind = 0; kind < 2; kind++) {
        g_assert_true(mdf_pack(from, to, (enum mdf_packed)kind, &bytes, &error));
        g_assert_cmpint(bytes, ==,
                        kind ? N_VIEWS * (TEXELS + (gint64)sizeof(float)) : 2 * N_VIEWS * TEXELS);
        g_autoptr(MdfTable) is = mdf_table_read(to, &error);
        g_assert_no_error(error);
        g_assert_cmpmem(t->seen, N_VIEWS * TEXELS, is->seen, N_VIEWS * TEXELS);
        for (int i = 0; i < N_VIEWS * TEXELS; i++)
            g_assert_cmpfloat_with_epsilon(is->depth_mm[i], t->depth_mm[i], most[kind]);
    }
    g_assert_false(mdf_pack(to, from, MDF_PACKED_8BIT, &bytes, &twice));
    g_assert_nonnull(strstr(twice->message, "already packed"));
    write_views(from, TRUE);
    g_assert_false(mdf_pack(from, to, MDF_PACKED_8BIT, &bytes, &none));
    g_assert_nonnull(strstr(none->message, "no channel D"));
}

static struct eigenmaps *grey(void) {
    struct eigenmaps *m = g_new0(struct eigenmaps, 1);
    m->name = g_strdup("grey");
    m->layout.width = m->layout.height = m->n_terms = m->layout.views.n = m->layout.lights.n = 1;
    m->layout.texel_mm = 1;
    m->layout.views.theta_deg = g_new0(float, 1);
    m->layout.views.phi_deg = g_new0(float, 1);
    m->layout.lights.theta_deg = g_new0(float, 1);
    m->layout.lights.phi_deg = g_new0(float, 1);
    m->weights = g_new(float, 1);
    m->maps = g_new(float, 3);
    m->weights[0] = 1;
    for (int c = 0; c < 3; c++)
        m->maps[c] = 0.5F;
    return m;
}

/* A torus of waves that are seen from all around, so that much of its outline is theirs. */
static struct mdf_table *waves(void) {
    struct mdf_table *t = new_table();
    for (int v = 0; v < N_VIEWS; v++)
        for (int x = 0; x < TEXELS; x++) {
            const int row = x / SIDE;
            const double u = 2 * G_PI * (x % SIDE) / SIDE, w = 2 * G_PI * row / SIDE;
            t->depth_mm[v * TEXELS + x] = (float)(0.6 + 0.5 * sin(2 * u) * cos(w) +
                                                  0.1 * sin(u + t->phi_deg[v] * G_PI / 180));
        }
    t->deepest_mm = 1.2;
    return t;
}

static gboolean *outline(Viewer *view, gboolean silhouettes) {
    struct viewer_settings s = viewer_settings_default;
    s.silhouettes = silhouettes;
    g_autofree float *seen = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_TEXEL, W, H, ERR));
    gboolean *ret = g_new(gboolean, W * H);
    for (int i = 0; i < W * H; i++)
        ret[i] = seen[4 * i + 3] > 0.5F;
    return ret;
}

static int differ(const gboolean *a, const gboolean *b) {
    int n = 0;
    for (int i = 0; i < W * H; i++)
        n += a[i] != b[i];
    return n;
}

/* What the card makes of compressed distances is what the processor does. */
GPU_TEST(drawn) {
    g_autoptr(GError) error = NULL;
    const struct scene_options scene = {3, 1, SCENE_Z_UP, FALSE};
    struct mesh *mesh = scene_make("torus", &scene, &error);
    struct eigenmaps *material = grey();
    g_autoptr(Viewer) view = viewer_new(material, &error);
    g_assert_no_error(error);
    g_assert_true(viewer_set_mesh(view, mesh, &error));
    g_autoptr(MdfTable) t = waves();
    g_autoptr(MdfBlocks) blocks = mdf_blocks_new(t);
    g_autofree gboolean *smooth = outline(view, FALSE);
    g_autofree char *path = g_build_filename(world_fixture_folder(), "drawn.exr", NULL);

    g_autoptr(MdfTable) flat = mdf_blocks_table(blocks);
    mdf_table_add_grazing(flat);
    g_assert_true(viewer_set_mdf(view, &(struct mdf_source){.table = flat}, &error));
    g_autofree gboolean *raw = outline(view, TRUE);
    g_assert_true(mdf_blocks_write(path, blocks, &error));
    g_assert_true(viewer_open_mdf(view, path, &error));
    g_autofree gboolean *in_blocks = outline(view, TRUE);

    mdf_table_add_grazing(t);
    g_autoptr(MdfFactors) few = mdf_factors_compute(t, N_VIEWS, 6, 0, NULL, &error);
    g_assert_no_error(error);
    g_autoptr(MdfTable) of_few = mdf_factors_table(few);
    g_assert_true(viewer_set_mdf(view, &(struct mdf_source){.table = of_few}, &error));
    g_autofree gboolean *raw_few = outline(view, TRUE);
    g_assert_true(mdf_factors_write(path, few, &error));
    g_assert_true(viewer_open_mdf(view, path, &error));
    g_autofree gboolean *drawn_few = outline(view, TRUE);

    g_test_message("pixels that structure changes: %d; of them as blocks %d, as maps %d differ",
                   differ(raw, smooth), differ(raw, in_blocks), differ(raw_few, drawn_few));
    g_assert_cmpint(differ(raw, smooth), >, 400);
    g_assert_cmpint(differ(raw, in_blocks), <=, differ(raw, smooth) / 50);
    g_assert_cmpint(differ(raw_few, drawn_few), <=, differ(raw, smooth) / 50);
    eigenmaps_free(material);
    mesh_free(mesh);
}

static int command(const char *const *arguments, char **ret_output) {
    g_autofree const char **argv = process_argv(BUILD_DIR "/bin/mesorig", arguments);
    g_autofree char *errors = NULL;
    return process_run(argv, ret_output, &errors);
}

TEST(commands) {
    g_autofree char *from = g_build_filename(world_fixture_folder(), "views.exr", NULL);
    g_autofree char *to = g_build_filename(world_fixture_folder(), "to.exr", NULL);
    const char *const maps[] = {"compress", from, "--method=mdf", "--components", "3", "-o",
                                to,         NULL};
    const char *const views[] = {"compress", from, "--method=mdf-views", "-o", to, "--force", NULL};
    const char *const bytes[] = {"compress", from, "--method=mdf-views", "-q", "8bit", "-o", to,
                                 "--force",  NULL};
    const char *const info[] = {"info", to, NULL};
    const struct {
        const char *const *arguments;
        const char *says, *info;
    } good[] = {{maps, "3 maps for 24 views", "3 maps of 24 × 24 texels"},
                {views, "24 views in 4 bit", "24 views of 24 × 24 texels"},
                {bytes, "24 views in 8 bit", "mesorig.scale_mm"}};
    const char *const bad[][8] = {
        {"compress", from, "--method=mdf", NULL},
        {"compress", from, "--method=mdf", "--components", "33", "-o", to, NULL},
        {"compress", from, "--method=mdf", "-q", "8bit", "-o", to, NULL},
        {"compress", from, "--method=mdf-views", "-q", "float", "-o", to, NULL},
        {"compress", from, "--method=mdf-views", "--components", "3", "-o", to, NULL},
    };
    write_views(from, FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(good); i++) {
        g_autofree char *said = NULL, *shown = NULL;
        g_assert_cmpint(command(good[i].arguments, &said), ==, 0);
        g_assert_nonnull(strstr(said, good[i].says));
        g_assert_cmpint(command(info, &shown), ==, 0);
        g_assert_nonnull(strstr(shown, good[i].info));
    }
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autofree char *said = NULL;
        g_assert_cmpint(command(bad[i], &said), ==, 2);
    }
}

BEFORE_TESTS {
    g_setenv("LC_ALL", "C.UTF-8", TRUE); /* what commands say is compared */
}

AFTER_TESTS {
    world_fixture_clean();
}
