/*
 * Every command must refuse immediately a file that is a FIFO, an endless device, a directory or a
 * dangling link. It must also refuse a file of some kilobytes whose header states more pixels than
 * fit into memory.
 */
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <openexr.h>
#include <png.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "pictures/picture_header.h"
#include "world/samples/sample.h"

/* of a command, start included; while its host stops a virtual machine, CPU time goes on */
#define MAX_CPU_S  60
#define MAX_WALL_S 300 /* the machine may have more to do; what hangs is ended then */
#define MAX_KIB    (1 << 20)
#define BOARD      "8x8,square=9,marker=6.75,dictionary=4x4_50,thickness=3"

static char *folder, *session;

enum special { A_FIFO, A_DEVICE, A_DIRECTORY, A_DANGLING_LINK, SPECIALS };
static const char *const names[SPECIALS] = {"fifo", "zero", "directory", "dangling"};
static const char *const says[SPECIALS] = {"a FIFO", "a character device", "irectory", ""};

/* What a path is that ends in suffix; made at its first use. */
static char *special_path(enum special which, const char *suffix) {
    g_autofree char *name = g_strconcat(names[which], suffix, NULL);
    char *path = g_build_filename(folder, name, NULL);
    struct stat status;
    if (lstat(path, &status) == 0)
        return path;
    const int failed = which == A_FIFO        ? mkfifo(path, 0600)
                       : which == A_DEVICE    ? symlink("/dev/zero", path)
                       : which == A_DIRECTORY ? g_mkdir(path, 0700)
                                              : symlink("nowhere", path);
    g_assert_cmpint(failed, ==, 0);
    return path;
}

struct running {
    char *command, *path, *log;
    GPid pid;
    gint64 begun_us;
};

static void start(struct running *running, char *const *argv, const char *path) {
    static int n;
    running->command = g_strjoinv(" ", (char **)argv);
    running->path = g_strdup(path);
    running->log = g_strdup_printf("%s/log%d", folder, n++);
    running->begun_us = g_get_monotonic_time();
    const int log = open(running->log, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    g_assert_cmpint(log, >=, 0);
    ok(g_spawn_async_with_fds(folder, (char **)argv, NULL, G_SPAWN_DO_NOT_REAP_CHILD, NULL, NULL,
                              &running->pid, -1, log, log, ERR));
    close(log);
}

/* The text it has printed. */
static char *finish(struct running *running, struct rusage *usage) {
    int status = 0;
    char *text = NULL;
    while (wait4(running->pid, &status, WNOHANG, usage) == 0) {
        if (g_get_monotonic_time() - running->begun_us > MAX_WALL_S * G_USEC_PER_SEC) {
            kill(running->pid, SIGKILL);
            wait4(running->pid, &status, 0, usage);
            g_error("%s: hangs", running->command);
        }
        g_usleep(2000);
    }
    g_assert_true(g_file_get_contents(running->log, &text, NULL, NULL));
    if (!WIFEXITED(status) || (WEXITSTATUS(status) != 1 && WEXITSTATUS(status) != 2))
        g_error("%s: ends with wait status 0x%x: %s", running->command, (unsigned)status, text);
    return text;
}

static void check(struct running *running, const char *wanted) {
    struct rusage usage;
    g_autofree char *text = finish(running, &usage);
    const double cpu_s = (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                         (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec) / G_USEC_PER_SEC;
    if (!strstr(text, running->path) || !strstr(text, wanted) || strstr(text, "Sanitizer"))
        g_error("%s: does not say that %s is %s: %s", running->command, running->path, wanted,
                text);
    if (cpu_s > MAX_CPU_S || usage.ru_maxrss > MAX_KIB)
        g_error("%s: takes %.1f s and %ld KiB: %s", running->command, cpu_s, usage.ru_maxrss, text);
    g_test_message("%.2f s, %ld MiB: %s", cpu_s, usage.ru_maxrss >> 10, g_strstrip(text));
    g_free(running->command);
    g_free(running->path);
    g_free(running->log);
}

/* What a word of a command stands for; NULL: itself. "@.exr": the special file; SESSION: a good
 * session; PICTURES: a folder. */
static char *meaning(const char *word, enum special which) {
    if (word[0] == '@')
        return special_path(which, word + 1);
    if (strcmp(word, "SESSION") == 0)
        return g_strdup(session);
    if (strcmp(word, "PICTURES") == 0)
        return g_build_filename(folder, "pictures", NULL);
    if (strcmp(word, "OUT") == 0)
        return g_build_filename(folder, "out.session", NULL);
    if (g_str_has_prefix(word, "SMALL/"))
        return g_build_filename(SOURCE_DIR, "tests", "small", word + strlen("SMALL/"), NULL);
    return NULL;
}

/* ret_path, which may be NULL: the special file's. */
static char **arguments_of(const char *command, enum special which, char **ret_path) {
    char **argv = g_strsplit(command, " ", -1);
    for (int i = 0; argv[i]; i++) {
        const gboolean special = argv[i][0] == '@';
        char *new =
            i == 0 ? g_build_filename(BUILD_DIR, "bin", argv[i], NULL) : meaning(argv[i], which);
        if (!new)
            continue;
        g_free(argv[i]);
        argv[i] = new;
        if (special && ret_path) {
            g_free(*ret_path);
            *ret_path = g_strdup(new);
        }
    }
    return argv;
}

static const char *const commands[] = {
    "mesorig plan @.conf SMALL/session.conf",
    "mesorig plan SMALL/rig.conf @.conf",
    "mesorig capture @.conf SMALL/session.conf -o OUT",
    "mesorig capture SMALL/rig.conf @.conf -o OUT",
    "mesorig capture SMALL/rig.conf SMALL/session.conf -c @.calibration -o OUT",
    "mesorig process SESSION -c @.calibration",
    "mesorig compare @.exr @.exr",
    "mesorig compare @.png @.png",
    "mesorig compare @.jpg @.jpg",
    "mesorig compare @.tif @.tif",
    "mesorig info @.exr",
    "mesorig info @.calibration",
    "mesorig import btf @.btf -o OUT",
    "mesorig import rti @.lp -o OUT",
    "mesorig import poses @.csv -c SMALL/rig.conf --sample 10x10 -o OUT",
    "mesorig resample SESSION -d @.csv -o OUT",
    "mesorig calibrate show @.calibration",
    "mesorig calibrate report @.calibration -o out.html",
    "mesorigd --safe-state @.conf",
    "mesorigd --listen unix:path=bus --rig @.conf",
    "mesorig-view @.exr -o out.png",
    "mesorig-view --shape @.obj -o out.png",
    "mesorig-view --shape @.gltf -o out.png",
    "mesorig-view --shape @.glb -o out.png",
    "mesorig-view --environment @.exr -o out.png",
    "mesorig-view --method metal-ward --normal-map @.png -o out.png",
    "mesorig-view --method metal-ward --normal-map @.exr -o out.png",
};

TEST(commands) {
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++) {
        struct running running[SPECIALS];
        for (int k = 0; k < SPECIALS; k++) {
            g_autofree char *path = NULL;
            g_auto(GStrv) argv = arguments_of(commands[i], (enum special)k, &path);
            start(&running[k], argv, path);
        }
        for (int k = 0; k < SPECIALS; k++)
            check(&running[k], says[k]);
    }
}

/* Files within a copy of a good session, or in a folder next to it, that are not files: "COPY/…".
 */
static const struct planted {
    const char *file, *command;
} planted[] = {
    {"COPY/session.db", "mesorig info COPY"},
    {"COPY/session.db-journal", "mesorig info COPY"},
    {"COPY/session.db-wal", "mesorig process COPY"},
    {"COPY/control", "mesorig pause COPY"},
    {"COPY/products/eigenmaps.exr", "mesorig-view COPY -o out.png"},
    {"COPY/products/eigenmaps.exr", "mesorig compare COPY/products/eigenmaps.exr SESSION"},
    {"COPY/products/btf/view_0001.exr", "mesorig check COPY"},
    {"COPY/products/btf/view_0001.exr", "mesorig compress COPY"},
    {"COPY/products/btf/view_0001.exr", "mesorig export btf COPY -o out.btf"},
    {"COPY/products/btf/view_0001.exr", "mesorig resample COPY -o OUT"},
    {"COPY/tl000_pl000_tv000_pv000.png", "mesorig import pictures COPY -o OUT"},
    {"COPY/list.lp", "mesorig import rti COPY/list.lp -o OUT"},
    {"COPY/photo.jpg", "mesorig calibrate lights --images COPY --ball 90,90,50 -o out.cal"},
    {"COPY/photo.jpg", "mesorig calibrate cameras --images COPY --board " BOARD " -o out.cal"},
    {"COPY/photo.dng", "mesorig calibrate cameras --images COPY --board " BOARD " -o out.cal"},
    {"COPY/film.mp4",
     "mesorig calibrate cameras --images COPY/film.mp4 --board " BOARD " -o out.cal"},
    {"COPY/shape.bin", "mesorig-view --shape COPY/shape.gltf -o out.png"},
    {"COPY/target.conf", "mesorig calibrate lights SESSION --target COPY/target.conf -o out.cal"},
    {"COPY/rig.conf", "mesorig resume --rig COPY/rig.conf SESSION"},
};

static void run(const char *command) {
    int status = 0;
    ok(g_spawn_command_line_sync(command, NULL, NULL, &status, ERR));
    g_assert_true(g_spawn_check_wait_status(status, NULL));
}

/* A glTF file whose buffer is a file next to it. */
static void write_shape(const char *copy) {
    g_autofree char *path = g_build_filename(copy, "shape.gltf", NULL);
    g_assert_true(g_file_set_contents(
        path,
        "{\"asset\": {\"version\": \"2.0\"}, \"scene\": 0, \"scenes\": [{\"nodes\": [0]}],"
        "\"nodes\": [{\"mesh\": 0}], \"meshes\": [{\"primitives\": [{\"attributes\": "
        "{\"POSITION\": 0}}]}], \"accessors\": [{\"bufferView\": 0, \"componentType\": 5126, "
        "\"count\": 3, \"type\": \"VEC3\"}], \"bufferViews\": [{\"buffer\": 0, \"byteLength\": "
        "36}],"
        "\"buffers\": [{\"byteLength\": 36, \"uri\": \"shape.bin\"}]}",
        -1, NULL));
}

static char *copy_session(gsize i, enum special which, const char *file) {
    char *copy = g_strdup_printf("%s/copy%zu-%s.session", folder, i, names[which]);
    g_autofree char *command = g_strdup_printf("cp -r %s %s", session, copy);
    g_autofree char *path = g_build_filename(copy, file + strlen("COPY/"), NULL);
    run(command);
    write_shape(copy);
    g_unlink(path);
    g_assert_cmpint(which == A_FIFO ? mkfifo(path, 0600) : symlink("/dev/zero", path), ==, 0);
    return copy;
}

static void start_planted(struct running *running, gsize i, enum special which) {
    g_autofree char *copy = copy_session(i, which, planted[i].file);
    g_auto(GStrv) words = g_strsplit(planted[i].command, "COPY", -1);
    g_autofree char *command = g_strjoinv(copy, words);
    g_auto(GStrv) argv = arguments_of(command, which, NULL);
    start(running, argv, copy);
}

TEST(planted) {
    for (gsize i = 0; i < G_N_ELEMENTS(planted); i++) {
        struct running fifo, device;
        start_planted(&fifo, i, A_FIFO);
        start_planted(&device, i, A_DEVICE);
        const gboolean quiet = g_str_has_suffix(planted[i].file, "control");
        check(&fifo, quiet ? "no daemon captures" : says[A_FIFO]);
        check(&device, quiet ? "no daemon captures" : says[A_DEVICE]);
    }
}

/* Playlists that FFmpeg would follow to whatever they name: here a FIFO next to them. */
TEST(playlists) {
    static const char *const texts[] = {
        "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\npart.ts\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile part.ts\n",
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 9 RTP/AVP 96\n"};
    g_autofree char *part = g_build_filename(folder, "part.ts", NULL);
    g_autofree char *path = g_build_filename(folder, "list.mp4", NULL);
    g_autofree char *command =
        g_strdup_printf("mesorig calibrate cameras --images %s --board " BOARD " -o out.cal", path);
    g_assert_cmpint(mkfifo(part, 0600), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        struct running running;
        g_auto(GStrv) argv = arguments_of(command, A_FIFO, NULL);
        g_assert_true(g_file_set_contents(path, texts[i], -1, NULL));
        start(&running, argv, path);
        check(&running, "not a video");
    }
}

/* What a simulated world's file names. */
TEST(samples) {
    for (int k = 0; k < SPECIALS; k++) {
        g_autoptr(GError) relief = NULL, obj = NULL, print = NULL;
        g_autofree char *path = special_path((enum special)k, ".sample");
        struct sample_options options = {
            .path = path, .albedo_path = path, .width_mm = 10, .height_mm = 10, .grid = 2};
        g_assert_null(sample_picture(&options, &relief));
        g_assert_null(sample_obj(&options, &obj));
        g_assert_null(sample_plate(&options, &print));
        g_assert_nonnull(strstr(relief->message, says[k]));
        g_assert_nonnull(strstr(obj->message, says[k]));
        g_assert_nonnull(strstr(print->message, says[k]));
    }
}

#define BOMB_SIDE 9000 /* 81 million pixels: 1.3 GB once they are floats */

/* Black, a bit a pixel: ten kilobytes. */
static void write_png_bomb(const char *path) {
    g_autofree guint8 *row = g_malloc0(BOMB_SIDE / 8);
    FILE *file = g_fopen(path, "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    g_assert_nonnull(file);
    png_init_io(png, file);
    png_set_IHDR(png, info, BOMB_SIDE, BOMB_SIDE, 1, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (int y = 0; y < BOMB_SIDE; y++)
        png_write_row(png, row);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    g_assert_cmpint(fclose(file), ==, 0);
}

#define BOMB_WIDTH  8192
#define BOMB_HEIGHT 16384 /* with one channel of floats 512 MiB */
#define CHUNK_LINES 16    /* of EXR's ZIP */

/* Zeros as EXR's predictor leaves them, by deflate. */
static GByteArray *packed_chunk(void) {
    const gsize size = (gsize)BOMB_WIDTH * CHUNK_LINES * sizeof(float);
    g_autofree guint8 *plain = g_malloc(size);
    g_autofree guint8 *packed = g_malloc(size);
    g_autoptr(GZlibCompressor) zlib = g_zlib_compressor_new(G_ZLIB_COMPRESSOR_FORMAT_ZLIB, 9);
    g_autoptr(GError) error = NULL;
    gsize read, written;
    memset(plain, 128, size);
    plain[0] = 0;
    g_assert_cmpint(g_converter_convert(G_CONVERTER(zlib), plain, size, packed, size,
                                        G_CONVERTER_INPUT_AT_END, &read, &written, &error),
                    ==, G_CONVERTER_FINISHED);
    g_assert_cmpuint(read, ==, size);
    return g_byte_array_append(g_byte_array_new(), packed, (guint)written);
}

static void write_exr_bomb(const char *path) {
    exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t exr = NULL;
    g_autoptr(GByteArray) packed = packed_chunk();
    int part = -1;
    g_assert_cmpint(exr_start_write(&exr, path, EXR_WRITE_FILE_DIRECTLY, &how), ==, 0);
    g_assert_cmpint(exr_add_part(exr, "Y", EXR_STORAGE_SCANLINE, &part), ==, 0);
    g_assert_cmpint(exr_initialize_required_attr_simple(exr, part, BOMB_WIDTH, BOMB_HEIGHT,
                                                        EXR_COMPRESSION_ZIP),
                    ==, 0);
    g_assert_cmpint(exr_add_channel(exr, part, "Y", EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LINEAR, 1, 1),
                    ==, 0);
    g_assert_cmpint(exr_write_header(exr), ==, 0);
    for (int y = 0; y < BOMB_HEIGHT; y += CHUNK_LINES)
        g_assert_cmpint(exr_write_scanline_chunk(exr, part, y, packed->data, packed->len), ==, 0);
    g_assert_cmpint(exr_finish(&exr), ==, 0);
}

static void check_bomb(const char *name, const char *const *some, void (*write)(const char *)) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    struct stat status;
    write(path);
    g_assert_cmpint(stat(path, &status), ==, 0);
    g_assert_cmpint(status.st_size, <, 10 << 20);
    for (; *some; some++) {
        struct running running;
        g_auto(GStrv) words = g_strsplit(*some, "BOMB", -1);
        g_autofree char *command = g_strjoinv(path, words);
        g_auto(GStrv) argv = arguments_of(command, A_FIFO, NULL);
        start(&running, argv, path);
        check(&running, "at most");
    }
}

TEST(bombs) {
    static const char *const png[] = {
        "mesorig compare BOMB BOMB",
        "mesorig-view --method metal-ward --normal-map BOMB -o out.png",
        NULL,
    };
    static const char *const exr[] = {
        "mesorig import pictures PICTURES -o OUT",
        "mesorig-view BOMB -o out.png",
        "mesorig-view --environment BOMB -o out.png",
        "mesorig-view --method metal-ward --normal-map BOMB -o out.png",
        NULL,
    };
    g_autofree char *pictures = g_build_filename(folder, "pictures", NULL);
    g_assert_cmpint(g_mkdir(pictures, 0700), ==, 0);
    check_bomb("bomb.png", png, write_png_bomb);
    check_bomb("pictures/tl000_pl000_tv000_pv000.exr", exr, write_exr_bomb);
}

/* What is written is read, however well it compresses. */
TEST(own_zeros) {
    static const char *const y[] = {"Y", NULL};
    g_autofree char *path = g_build_filename(folder, "zeros.exr", NULL);
    struct exr_file *file = exr_file_new();
    struct stat status;
    exr_file_add(file, exr_part_new("Y", BOMB_WIDTH, BOMB_HEIGHT * 3 / 4, y, EXR_HALF));
    g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
    exr_file_free(file);
    g_assert_cmpint(stat(path, &status), ==, 0);
    g_test_message("%" G_GINT64_FORMAT " bytes", (gint64)status.st_size);
    file = ok(exr_read(path, ERR));
    exr_file_free(file);
}

/* Headers only, of 300 and of 30000 pixels each way: the former are let through to a decoder, the
 * latter refused with their size. */
TEST(headers) {
    static const struct {
        const char *kind;
        guint8 bytes[64];
        int width_at, height_at, n; /* bytes of a number */
        gboolean big_endian;
    } headers[] = {
        {"png", "\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16, 20, 4, TRUE},
        {"jpeg", "\xff\xd8\xff\xe0\0\4ab\xff\xff\xc0\0\21\10", 16, 14, 2, TRUE},
        {"tiff", "II*\0\10\0\0\0\2\0\0\1\4\0\1\0\0\0....\1\1\4\0\1\0\0\0....", 18, 30, 4, FALSE},
        {"tiff", "MM\0*\0\0\0\10\0\2\1\0\0\3\0\0\0\1..\0\0\1\1\0\3\0\0\0\1..", 18, 30, 2, TRUE},
        {"bigtiff",
         "II+\0\10\0\0\0\20\0\0\0\0\0\0\0\2\0\0\0\0\0\0\0\0\1\4\0\1\0\0\0\0\0\0\0....\0\0\0\0"
         "\1\1\4\0\1\0\0\0\0\0\0\0....",
         36, 56, 4, FALSE},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(headers); i++)
        for (int side = 300; side <= 30000; side *= 100) {
            g_autoptr(GError) error = NULL;
            guint8 bytes[64];
            memcpy(bytes, headers[i].bytes, sizeof bytes);
            for (int k = 0; k < headers[i].n; k++) {
                const int shift = 8 * (headers[i].big_endian ? headers[i].n - 1 - k : k);
                bytes[headers[i].width_at + k] = bytes[headers[i].height_at + k] =
                    (guint8)(side >> shift);
            }
            g_test_message("%s of %d pixels", headers[i].kind, side);
            const gboolean good = picture_header_check("a.file", bytes, sizeof bytes, &error);
            g_assert_cmpint(good, ==, side == 300);
            g_assert_true(good || strstr(error->message, "30000 × 30000"));
            g_clear_error(&error);
            for (gsize length = 0; length < sizeof bytes; length++) { /* cut off: no crash */
                g_autofree guint8 *cut = g_memdup2(bytes, length);
                picture_header_check("a.file", cut, length, NULL);
            }
        }
}

static void make_session(void) {
    g_autofree char *btf = g_build_filename(folder, "good.btf", NULL);
    g_autofree char *write = g_strdup_printf(
        "python3 " SOURCE_DIR "/tests/bonn_peer.py write bdi %s %s.values", btf, btf);
    g_autofree char *import =
        g_strdup_printf(BUILD_DIR "/bin/mesorig import btf %s -o %s", btf, session);
    run(write);
    run(import);
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-special-XXXXXX", NULL);
    session = g_build_filename(folder, "good.session", NULL);
    make_session();
}

AFTER_TESTS {
    remove_tree(folder);
}
