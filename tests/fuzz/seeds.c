/* Writes small files of every kind that is not text, for fuzzing to begin with, and the calibration
 * of a rig file: seeds FOLDER RIG.conf. */
#include "bus/queue.h"
#include "codecs/codecs.h"
#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"
#include "exr/checkpoint.h"
#include "exr/exr.h"
#include "geometry/rig.h"
#include "rig/devices.h"
#include "session/session.h"
#include "synthesis/index_map.h"

#include "fuzz.h"
#include "lib/material_fixture.h"
#include "lib/remove_tree.h"
#include "lib/waves_fixture.h"
#include "lib/write_dng.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <sqlite3.h>
#include <string.h>

#define SIDE 3

static char *file_in(const char *folder, const char *kind, const char *name) {
    g_autofree char *sub = g_build_filename(folder, kind, NULL);
    g_assert_cmpint(g_mkdir_with_parents(sub, 0700), ==, 0);
    return g_build_filename(sub, name, NULL);
}

static void write_exr(const char *path, enum exr_type type, enum exr_compression compression) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = 0; k < 2; k++) {
        struct exr_part *part = exr_part_new(k ? "two" : "one", 4, SIDE, channels, type);
        for (int i = 0; i < 4 * SIDE; i++)
            part->planes[0][i] = part->planes[2][i] = (float)i / 3;
        exr_set_string(part, "mesorig.cfa", "rggb");
        exr_set_int(part, "mesorig.view", 1);
        exr_set_double(part, "mesorig.exposure_us", 4000);
        exr_set_v3d(part, "mesorig.direction", 0, 0, 1);
        exr_file_add(file, part);
    }
    g_assert_true(exr_write(path, file, compression, FALSE, NULL));
}

static void write_exrs(const char *folder) {
    for (int type = EXR_HALF; type <= EXR_FLOAT; type++)
        for (int compression = EXR_NONE; compression <= EXR_PIZ; compression++) {
            g_autofree char *name = g_strdup_printf("%d%d.exr", type, compression);
            g_autofree char *path = file_in(folder, "exr", name);
            write_exr(path, (enum exr_type)type, (enum exr_compression)compression);
        }
}

/* A file of each codec, and one for each choice that an option of the codec has. */
static void write_materials(const char *folder) {
    struct btf_matrix *btf = waves_fixture_new(SIDE, SIDE, 4, 7, 0.002, FALSE);
    for (gsize i = 0; codecs[i]; i++) {
        g_autofree char *name = g_strdup_printf("%s.exr", codecs[i]->name);
        g_autofree char *path = file_in(folder, "material", name);
        material_fixture_write(path, codecs[i], btf, "");
        for (const struct option *option = codecs[i]->options; option->name; option++)
            for (int k = 0; option->type == OPTION_CHOICE && option->choices[k]; k++) {
                g_autofree char *choice = g_strdup_printf("%s-%s-%s.exr", codecs[i]->name,
                                                          option->name, option->choices[k]);
                /* Without a size or an error, a packed file would have no room. */
                g_autofree char *options =
                    g_strdup_printf("%s=%s%s", option->name, option->choices[k],
                                    options_find(codecs[i]->options, "error") ? " error=5%" : "");
                g_autofree char *with = file_in(folder, "material", choice);
                material_fixture_write(with, codecs[i], btf, options);
            }
    }
    btf_matrix_free(btf);
}

/* Three views of something bent, from which the other two kinds are made. */
static void write_views(const char *path) {
    static const char *const channels[] = {"D", "M", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    for (int view = 0; view < 3; view++) {
        g_autofree char *name = g_strdup_printf("view_%04d", view);
        struct exr_part *part = exr_part_new(name, 4, SIDE, channels, EXR_FLOAT);
        for (int i = 0; i < 4 * SIDE; i++)
            part->planes[0][i] = part->planes[1][i] = i ? (float)((i + view) % 5) : -1;
        exr_set_double(part, "view.theta_deg", 20 * view);
        exr_set_double(part, "view.phi_deg", 100 * view);
        exr_set_v3d(part, "view.centre_mm", 100 * view, 0, 500);
        exr_set_double(part, "reference_mm", 5);
        exr_set_double(part, "texel_mm", 0.5);
        exr_file_add(file, part);
    }
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
}

static void write_mdfs(const char *folder) {
    g_autofree char *views = file_in(folder, "mdf", "views.exr");
    g_autofree char *blocks_path = file_in(folder, "mdf", "blocks.exr");
    g_autofree char *factors_path = file_in(folder, "mdf", "factors.exr");
    write_views(views);
    struct mdf_table *table = mdf_table_read(views, NULL);
    struct mdf_blocks *blocks = mdf_blocks_new(table);
    struct mdf_factors *factors = mdf_factors_compute(table, 3, 1, 0, NULL, NULL);
    g_assert_true(mdf_blocks_write(blocks_path, blocks, NULL));
    g_assert_true(mdf_factors_write(factors_path, factors, NULL));
    mdf_factors_free(factors);
    mdf_blocks_free(blocks);
    mdf_table_free(table);
}

static void write_shape(const char *folder, const char *name, const void *bytes, gsize size) {
    g_autofree char *path = file_in(folder, "shape", name);
    g_assert_true(g_file_set_contents(path, bytes, (gssize)size, NULL));
}

/* JSON that takes its buffer from there: a triangle with texture coordinates. */
static char *triangle_json(const char *buffer) {
    return g_strdup_printf(
        "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{"
        "\"mesh\":0,\"scale\":[1,2,1]}],\"meshes\":[{\"primitives\":[{\"attributes\":{"
        "\"POSITION\":0,\"TEXCOORD_0\":1},\"indices\":2}]}],\"accessors\":[{\"bufferView\":0,"
        "\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},{\"bufferView\":1,"
        "\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"},{\"bufferView\":2,"
        "\"componentType\":5125,\"count\":3,\"type\":\"SCALAR\"}],\"bufferViews\":[{\"buffer\":0,"
        "\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":24},{\"buffer\":0,"
        "\"byteOffset\":60,\"byteLength\":12}],\"buffers\":[{\"byteLength\":72%s}]}",
        buffer);
}

static void write_shapes(const char *folder) {
    static const char obj[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
                              "vn 0 0 1\nf 1/1/1 2/2/1 3/3/1\nf -4/1 -2/3 -1/2\n";
    static const struct {
        float positions[9], uvs[6];
        guint32 indices[3];
    } buffer = {{0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 1, 0, 0, 1}, {0, 1, 2}};
    g_autofree char *base64 = g_base64_encode((const guchar *)&buffer, sizeof buffer);
    g_autofree char *uri =
        g_strconcat(",\"uri\":\"data:application/octet-stream;base64,", base64, "\"", NULL);
    g_autofree char *text = triangle_json(uri), *json = triangle_json("");
    const guint32 length = (guint32)strlen(json), binary = sizeof buffer;
    const guint32 head[5] = {0x46546c67, 2, 28 + length + binary, length, 0x4e4f534a};
    const guint32 next[2] = {binary, 0x004e4942};
    g_autoptr(GByteArray) glb = g_byte_array_new();
    g_byte_array_append(glb, (const guint8 *)head, sizeof head);
    g_byte_array_append(glb, (const guint8 *)json, length);
    g_byte_array_append(glb, (const guint8 *)next, sizeof next);
    g_byte_array_append(glb, (const guint8 *)&buffer, sizeof buffer);
    write_shape(folder, "shape.obj", obj, strlen(obj));
    write_shape(folder, "shape.gltf", text, strlen(text));
    write_shape(folder, "shape.glb", glb->data, glb->len);
}

static void write_calibration(const char *folder, const char *rig_path) {
    g_autofree char *path = file_in(folder, "calibration", "small.conf");
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    g_assert_true(devices_read_geometry(rig_path, rig, NULL));
    g_autofree char *text = rig_to_text(rig);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

/* A session with all of its tables filled, in small pages and without a log next to it. */
static void write_database(const char *folder) {
    static const struct session_texts texts = {"[rig]\n", "[session]\n", "", "/etc/rig.conf"};
    const struct session_direction view = {.theta_deg = 30, .phi_deg = 10, .note = (char[]){"n"}};
    const struct session_shot shots[] = {
        {.id = 1, .kind = SHOT_DARK, .source = -1, .device = -1, .cameras = {{1}}},
        {.id = 2, .kind = SHOT_LAMP, .cameras = {{1}}},
        {.id = 3, .kind = SHOT_SWEEP, .cameras = {{1}}, .sweep_to_deg = 1, .sweep_steps = 3}};
    const struct session_plan plan = {
        .grid = {.width = 4, .height = 4, .width_mm = 10, .height_mm = 10, .depth_mm = 1},
        .views = &view,
        .lights = &view,
        .lasers = &view,
        .n_views = 1,
        .n_lights = 1,
        .n_lasers = 1,
        .shots = shots,
        .n_shots = 3};
    g_autofree char *path = g_build_filename(folder, "s.session", NULL);
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    g_autofree char *to = file_in(folder, "database", "session");
    g_autoptr(GError) error = NULL;
    Session *session = session_create(path, "s", &texts, &plan, &error);
    g_assert_no_error(error);
    g_autofree char *frame = session_frame_path(&shots[1], "cam");
    g_autofree char *frame_file = session_file(session, frame);
    g_autofree char *product = session_file(session, "products/x.exr");
    g_assert_true(g_file_set_contents(frame_file, "f", 1, NULL));
    g_assert_true(g_file_set_contents(product, "p", 1, NULL));
    const struct session_frame row = {
        .shot = 2,
        .path = frame,
        .sha256 = g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)"f", 1),
        .bytes = 1};
    g_assert_true(session_commit_shot(session, 2, SHOT_DONE, &row, 1, NULL, NULL));
    g_assert_true(session_add_event(session, 1, "info", "axis", "homed", NULL));
    g_assert_true(session_add_product(session, "products/x.exr", "compress", NULL));
    session_close(session);
    g_free(row.sha256);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db,
                                 "PRAGMA journal_mode = DELETE; PRAGMA page_size = 512; VACUUM;",
                                 NULL, NULL, NULL),
                    ==, SQLITE_OK);
    sqlite3_close(db);
    g_assert_cmpint(g_rename(file, to), ==, 0);
    remove_tree(path);
}

static void write_checkpoint(const char *folder) {
    static const double weights[6] = {1, -0.5, 1e300};
    static const int done[5] = {1, 0, 1, 1, 0};
    g_autofree char *path = file_in(folder, "checkpoint", "lpca");
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(path);
    checkpoint_begin(checkpoint, FUZZ_CHECKPOINT_INPUTS);
    checkpoint_keep(checkpoint, "weights", weights, sizeof weights);
    checkpoint_keep_flags(checkpoint, "done", done, G_N_ELEMENTS(done));
    checkpoint_save(checkpoint);
    g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
}

/* Each filter of a mosaic, and none; with margins and levels. */
static void write_raws(const char *folder) {
    static const char *const filters[] = {"rggb", "bggr", "grbg", "gbrg", "mono"};
    guint16 values[32 * 24];
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++)
        values[i] = (guint16)(400 + i * 17);
    for (gsize i = 0; i < G_N_ELEMENTS(filters); i++) {
        g_autofree char *path = file_in(folder, "camera_raw", filters[i]);
        write_dng(path, &(struct dng){.width = 32,
                                      .height = 24,
                                      .values = values,
                                      .cfa = filters[i],
                                      .black = {512, 500, 520, 512},
                                      .white = 15000,
                                      .top = (int)i,
                                      .left = 2});
    }
}

/* A call as a message, and its options only. */
static void write_options(const char *folder) {
    static const char *const options[] = {
        "{'process': <true>, 'calibration': <'/c.conf'>}",
        "{'session_text': <'[session]'>, 'calibration_text': <''>, 'chosen': <'a = 1'>}",
        "{'yes': <false>, 'no': <(1, [2.5], {'a': <@ay []>})>}", "@a{sv} {}"};
    for (gsize i = 0; i < G_N_ELEMENTS(options); i++) {
        g_autoptr(GVariant) value = g_variant_ref_sink(g_variant_new_parsed(options[i]));
        g_autoptr(GDBusMessage) message =
            g_dbus_message_new_method_call("a.b", "/a", "a.b", "Start");
        gsize n = 0;
        g_dbus_message_set_serial(message, 1);
        g_dbus_message_set_body(message, g_variant_new("(ss@a{sv})", "/x", "/y", value));
        g_autofree guchar *blob =
            g_dbus_message_to_blob(message, &n, G_DBUS_CAPABILITY_FLAGS_NONE, NULL);
        g_autofree char *name = g_strdup_printf("message%d", (int)i);
        g_autofree char *bare = g_strdup_printf("value%d", (int)i);
        g_autofree char *path = file_in(folder, "options", name);
        g_autofree char *bare_path = file_in(folder, "options", bare);
        g_assert_true(g_file_set_contents(path, (const char *)blob, (gssize)n, NULL));
        g_assert_true(g_file_set_contents(bare_path, g_variant_get_data(value),
                                          (gssize)g_variant_get_size(value), NULL));
    }
}

static void write_queue(const char *folder) {
    g_autofree char *path = file_in(folder, "queue", "two");
    g_autoptr(Queue) queue = queue_open(path, NULL);
    for (int i = 0; i < 2; i++) {
        struct queue_item *item = queue_item_new();
        g_free(item->directory);
        item->directory = g_strdup_printf("/d%d", i);
        item->has_caller = i == 1;
        g_array_append_val(item->groups, item->uid);
        g_assert_true(queue_add(queue, item, NULL));
    }
    g_clear_pointer(&queue, queue_free);
    g_autofree char *lock = g_strconcat(path, ".lock", NULL);
    g_unlink(lock);
}

/* A map of two levels, and one of a sample of one texel. */
static void write_indices(const char *folder) {
    for (int k = 0; k < 2; k++) {
        g_autofree char *path = file_in(folder, "index", k ? "one.exr" : "map.exr");
        const int side = k ? 1 : 4;
        g_autoptr(IndexMap) map = index_map_new(side, side, side, side, 0.5, "quilting");
        for (int i = 0; i < side * side; i++) {
            map->levels[0][2 * i] = (guint16)(i % side);
            map->levels[0][2 * i + 1] = (guint16)(side - 1 - i / side);
        }
        if (!k) {
            map->n_levels = 2;
            map->levels[1] = g_new0(guint16, 2 * 2 * 2);
            map->levels[1][0] = 2;
        }
        g_assert_true(index_map_write(path, map, NULL));
    }
}

static void write_environments(const char *folder) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    for (int k = 0; k < 3; k++) {
        static const char *const names[] = {"black.exr", "sun.exr", "bright.exr"};
        g_autofree char *path = file_in(folder, "environment", names[k]);
        g_autoptr(ExrFile) file = exr_file_new();
        struct exr_part *part = exr_part_new("sky", 8, 4, channels, EXR_FLOAT);
        for (int i = 0; k > 0 && i < 8 * 4; i++)
            for (int c = 0; c < 3; c++)
                part->planes[c][i] = k == 2 ? 3e38F : i == 11 ? 1000 : 0.5F;
        exr_file_add(file, part);
        g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
    }
}

int main(int argc, char **argv) {
    g_assert_cmpint(argc, ==, 3);
    write_calibration(argv[1], argv[2]);
    write_exrs(argv[1]);
    write_materials(argv[1]);
    write_mdfs(argv[1]);
    write_shapes(argv[1]);
    write_database(argv[1]);
    write_checkpoint(argv[1]);
    write_options(argv[1]);
    write_queue(argv[1]);
    write_indices(argv[1]);
    write_environments(argv[1]);
    write_raws(argv[1]);
    return 0;
}
