/* A camera of a program: what every driver must do, the picture that arrived, and faults of the
 * program. */
#include "lib/camera_open.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "program/devices.h"
#include "program/pgm.h"

#include <glib/gstdio.h>
#include <string.h>

struct bench {
    const char *folder;
    Clock *clock;
    Camera *camera;
    int n, n_exposed;
    enum camera_event last;
    Frame *frame;
    GError *error;
};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct bench *bench = data;
    if (event == CAMERA_EXPOSED) {
        bench->n_exposed++;
        return;
    }
    bench->n++;
    bench->last = event;
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
    g_clear_pointer(&bench->frame, frame_unref);
    bench->frame = frame ? frame_ref(frame) : NULL;
}

static gboolean open_model(struct bench *bench, int start_s, GError **error) {
    const struct config_section *section;
    g_autofree char *text = program_model_section("camera", bench->folder, start_s, "");
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    bench->camera = camera_open(&program_camera_driver, section, NULL, bench->clock, error);
    if (!bench->camera)
        return FALSE;
    camera_listen(bench->camera, on_event, bench);
    return TRUE;
}

static void configure(struct bench *bench, gint64 exposure_us) {
    const struct camera_settings settings = {exposure_us, 0};
    ok(camera_configure(bench->camera, &settings, ERR));
}

static void begin(struct bench *bench, const char *folder) {
    *bench = (struct bench){.folder = folder, .clock = clock_new_real()};
    ok(open_model(bench, 20, ERR));
    configure(bench, 1000);
    ok(camera_arm(bench->camera, ERR));
}

/* Nothing is left behind: no process, and no folder of pictures. */
static void end(struct bench *bench) {
    g_clear_pointer(&bench->camera, camera_close);
    g_clear_pointer(&bench->clock, clock_unref);
    g_clear_pointer(&bench->frame, frame_unref);
    g_clear_error(&bench->error);
    g_autofree char *pictures = program_model_read(bench->folder, "pictures");
    g_assert_false(g_file_test(pictures, G_FILE_TEST_EXISTS));
    UNTIL (program_model_processes(bench->folder) == 0)
        g_usleep(10000);
}

static void shoot(struct bench *bench, guint64 shot, enum camera_event event) {
    bench->n = bench->n_exposed = 0;
    ok(camera_trigger(bench->camera, shot, ERR));
    conformance_wait(bench->clock, &bench->n, 1, 60);
    if (event == CAMERA_FRAME)
        g_assert_no_error(bench->error);
    g_assert_cmpint(bench->last, ==, event);
}

/* The first pixel is the exposure. */
TEST(truth) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    const struct camera_format *format = &bench.camera->format;
    g_assert_cmpint(format->width, ==, 8);
    g_assert_cmpint(format->height, ==, 6);
    g_assert_cmpint(format->bits, ==, 12);
    g_assert_cmpint(format->cfa, ==, CFA_MONO);
    g_assert_cmpfloat(format->black_level, ==, 64);
    g_assert_cmpint(format->trigger_us, ==, 5000);
    g_assert_cmpint(format->readout_us, ==, 50000);
    shoot(&bench, 1, CAMERA_FRAME);
    g_assert_cmpint(bench.frame->pixels[0], ==, 1000);
    g_assert_cmpint(bench.n_exposed, ==, 1);
    configure(&bench, 2500);
    shoot(&bench, 2, CAMERA_FRAME);
    g_assert_cmpint(bench.frame->pixels[0], ==, 2500);
    g_assert_cmpuint(bench.frame->id, ==, 2);
    end(&bench);
}

/* A trigger that was given up gives no picture to the next one. */
TEST(given_up) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    configure(&bench, 300000);
    ok(camera_trigger(bench.camera, 1, ERR));
    conformance_pass(bench.clock, 0.1);
    camera_disarm(bench.camera);
    configure(&bench, 2000);
    ok(camera_arm(bench.camera, ERR));
    shoot(&bench, 2, CAMERA_FRAME);
    g_assert_cmpint(bench.frame->pixels[0], ==, 2000);
    end(&bench);
}

/* Each fault comes with the second picture. Afterwards the camera works again. */
static const struct fault {
    const char *name;
    enum camera_event event;
    enum device_error code;
    const char *says;
} faults[] = {
    {"unanswered", CAMERA_FAULT, DEVICE_ERROR_TIMEOUT, "did not answer “trigger” within 1656 ms"},
    {"dies", CAMERA_FAULT, DEVICE_ERROR_DISCONNECTED, "has ended with exit code 3"},
    {"garbage", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "not a JSON object"},
    {"refuses", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "refused “trigger”: the fuse has?blown"},
    {"late", CAMERA_REFUSED, DEVICE_ERROR_STALE, "before the trigger"},
    {"future", CAMERA_REFUSED, DEVICE_ERROR_PROTOCOL, "its time stamp is in the future"},
    {"repeats", CAMERA_REFUSED, DEVICE_ERROR_STALE, "it is an old frame"},
    {"same", CAMERA_REFUSED, DEVICE_ERROR_STALE, "it repeats the frame of shot 1 bit for bit"},
    {"cut-off", CAMERA_REFUSED, DEVICE_ERROR_PROTOCOL, "some of its data was lost"},
    {"unnumbered", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "sent an answer without the number “id”"},
    {"wider", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "a picture of 9 × 6 pixels, not of 8 × 6"},
    {"too-bright", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "value 4096, which has more than 12 bits"},
    {"colour", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "is not a PGM file"},
    {"outside", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "not the name of a file in its folder"},
    {"elsewhere", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "not the name of a file in its folder"},
    {"no-file", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "wrote no picture “2.pgm”"},
    {"pipe", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "“2.pgm” that is not a regular file"},
    {"link", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL, "wrote no picture “2.pgm”"},
    {"long", CAMERA_FAULT, DEVICE_ERROR_PROTOCOL,
     "bytes, but a picture of this camera has at most 1120"},
};

static void run_fault(gconstpointer data) {
    const struct fault *fault = data;
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    shoot(&bench, 1, CAMERA_FRAME);
    program_model_fail(folder, fault->name);
    shoot(&bench, 2, fault->event);
    g_assert_error(bench.error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(bench.error->message, "camera test: "));
    assert_has(bench.error->message, fault->says);
    program_model_fail(folder, "");
    ok(camera_arm(bench.camera, ERR));
    shoot(&bench, 3, CAMERA_FRAME);
    end(&bench);
}

/* A file that the program has written for an earlier picture is no picture. */
TEST(left_behind) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(folder, "leaves-a-copy");
    shoot(&bench, 1, CAMERA_FRAME);
    program_model_fail(folder, "names-the-copy");
    shoot(&bench, 2, CAMERA_FAULT);
    assert_has(bench.error->message, "wrote no picture “copy.pgm”");
    end(&bench);
}

/* A picture without a time stamp that comes before its exposure can be over. */
TEST(early) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    configure(&bench, 1000000);
    program_model_fail(folder, "early");
    shoot(&bench, 1, CAMERA_REFUSED);
    assert_has(bench.error->message, "its time stamp is in the future");
    end(&bench);
}

/* The program ends between two pictures. */
TEST(dies_idle) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    shoot(&bench, 1, CAMERA_FRAME);
    bench.n = 0;
    program_model_kill(folder);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    g_assert_cmpint(bench.last, ==, CAMERA_FAULT);
    g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    ok(camera_arm(bench.camera, ERR));
    shoot(&bench, 2, CAMERA_FRAME);
    end(&bench);
}

TEST(gain) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    const struct camera_settings settings = {1000, 6};
    g_autoptr(GError) error = NULL;
    begin(&bench, folder);
    g_assert_false(camera_configure(bench.camera, &settings, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED);
    assert_has(error->message, "cannot set a gain of 6 dB; use gain_db = 0");
    end(&bench);
}

/* A camera that lists its exposure times has no others. */
TEST(listed_exposures) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    const struct camera_settings settings = {1400, 0};
    g_autoptr(GError) error = NULL;
    program_model_fail(folder, "lists-times");
    begin(&bench, folder);
    g_assert_false(camera_configure(bench.camera, &settings, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_RANGE);
    assert_has(error->message,
               "cannot expose for 1400 µs; the nearest time that it has is 1000 µs");
    configure(&bench, 2000);
    configure(&bench, 2001); /* rounded differently */
    end(&bench);
}

static const struct fault open_faults[] = {
    {"dies-at-start", 0, DEVICE_ERROR_DISCONNECTED, "has ended with exit code 1"},
    {"too-many-bits", 0, DEVICE_ERROR_PROTOCOL, "answered bits = 17, which is out of range"},
    {"new-filter", 0, DEVICE_ERROR_PROTOCOL, "answered cfa = “rgbg”, which is not mono, rggb"},
    {"no-times", 0, DEVICE_ERROR_PROTOCOL,
     "sent an answer in which “exposures_us” is not an array of numbers"},
    {"odd-times", 0, DEVICE_ERROR_PROTOCOL, "a value of “exposures_us” that is not a whole number"},
    {"cut", 0, DEVICE_ERROR_TIMEOUT, "has not started within 1 s"},
};

static void run_open_fault(gconstpointer data) {
    const struct fault *fault = data;
    TEMPORARY_FOLDER(folder);
    struct bench bench = {.folder = folder, .clock = clock_new_real()};
    g_autoptr(GError) error = NULL;
    program_model_fail(folder, fault->name);
    g_assert_false(open_model(&bench, fault->code == DEVICE_ERROR_TIMEOUT ? 1 : 20, &error));
    g_assert_error(error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(error->message, "camera test: "));
    assert_has(error->message, fault->says);
    end(&bench);
}

/* 8 bits, and comments between the numbers. */
TEST(pgm) {
    static const char small[] = "P5 # small\n2\t2#\n255\n\x01\x02\x03\xff";
    static const char *const wrong[] = {"",
                                        "P5",
                                        "P5 2 2 255",
                                        "P5 2 2 0\nabcd",
                                        "P5 2 2 65536\nabcd",
                                        "P5 2 99999999999999999999 255\nabcd",
                                        "P5 -2 2 255\nabcd",
                                        "P5 3 2 255\nabcdef"};
    guint16 pixels[4];
    gboolean complete;
    ok(pgm_parse((const guint8 *)small, sizeof small - 1, 2, 2, 8, pixels, &complete, ERR));
    g_assert_true(complete);
    g_assert_cmpint(pixels[0], ==, 1);
    g_assert_cmpint(pixels[1], ==, 2);
    g_assert_cmpint(pixels[2], ==, 3);
    g_assert_cmpint(pixels[3], ==, 255);
    ok(pgm_parse((const guint8 *)small, sizeof small - 2, 2, 2, 8, pixels, &complete, ERR));
    g_assert_false(complete);
    g_assert_cmpint(pixels[3], ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_false(pgm_parse((const guint8 *)wrong[i], strlen(wrong[i]), 2, 2, 8, pixels,
                                 &complete, &error));
        g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    }
}

static char *model_folder;

/* The example of contrib/, with programs that write files as rpicam-still and dcraw do. */
static struct conformance example = {.name = "rpicam.py", .real_clock = TRUE, .exposure_us = 2000};

static void write_program(const char *name, const char *text) {
    g_autofree char *path = g_build_filename(model_folder, name, NULL);
    g_autofree char *whole = g_strconcat("#!" PROGRAM_PYTHON "\nimport random, struct, sys, time\n",
                                         "arguments = sys.argv\n", text, NULL);
    text_file_write(model_folder, name, whole);
    g_assert_cmpint(g_chmod(path, 0755), ==, 0);
}

static void set_up_example(void) {
    g_autofree char *path = g_strconcat(model_folder, ":", g_getenv("PATH"), NULL);
    write_program("rpicam-still", "shutter = arguments[arguments.index('--shutter') + 1]\n"
                                  "time.sleep(int(shutter) / 1e6)\n"
                                  "output = arguments[arguments.index('--output') + 1]\n"
                                  "open(output.replace('.jpg', '.dng'), 'w').write(shutter)\n");
    write_program(
        "dcraw", "values = [int(open(arguments[-1]).read()) % 4096]\n"
                 "values += [random.randrange(4096) for i in range(7)]\n"
                 "sys.stdout.buffer.write(b'P5\\n4 2\\n65535\\n' + struct.pack('>8H', *values))\n");
    g_setenv("PATH", path, TRUE);
    example.section =
        g_strdup("[camera test]\ndriver = program-camera\nprogram = " PROGRAM_PYTHON
                 "\narguments = " SOURCE_DIR "/contrib/programs/rpicam.py;4;2;bggr;12;256\n");
    conformance_camera(&program_camera_driver, &example);
}

TEST(example) {
    const struct config_section *section;
    struct bench bench = {.folder = model_folder, .clock = clock_new_real()};
    g_autoptr(Config) config = conformance_config(&example, "", &section);
    bench.camera = ok(camera_open(&program_camera_driver, section, NULL, bench.clock, ERR));
    camera_listen(bench.camera, on_event, &bench);
    g_assert_cmpint(bench.camera->format.cfa, ==, CFA_BGGR);
    const struct camera_settings settings = {3000, 6};
    ok(camera_configure(bench.camera, &settings, ERR));
    ok(camera_arm(bench.camera, ERR));
    shoot(&bench, 1, CAMERA_FRAME);
    g_assert_cmpint(bench.frame->pixels[0], ==, 3000);
    end(&bench);
}

static struct conformance model = {
    .name = "program-camera", .real_clock = TRUE, .exposure_us = 2000};

BEFORE_TESTS {
    model_folder = remove_tree_begin();
    model.section = program_model_section("camera", model_folder, 20, "");
    conformance_camera(&program_camera_driver, &model);
    set_up_example();
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strdup_printf("/program-camera/fault/%s", faults[i].name);
        g_test_add_data_func(path, &faults[i], run_fault);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(open_faults); i++) {
        g_autofree char *path = g_strdup_printf("/program-camera/open/%s", open_faults[i].name);
        g_test_add_data_func(path, &open_faults[i], run_open_fault);
    }
}

AFTER_TESTS {
    remove_tree_end(&model_folder);
    g_free((gpointer)model.section);
    g_free((gpointer)example.section);
}
