/* The conformance suite over every simulated driver. */
#include "lib/camera_open.h"
#include "lib/simulated.h"
#include "lib/wait.h"

static const struct conformance slide = {
    .name = "sim-slide",
    .section = "[axis slide]\nmin_deg = -15\nmax_deg = 15\nspeed_deg_s = 30\naccel_deg_s2 = 400\n"
               "backlash_deg = 0.2\nlatency_ms = 35\n",
};
static const struct conformance quick_camera = {
    .name = "sim-camera-real-time",
    .path = RIG,
    .section = "[camera cam30]\nworld = world.conf\nreadout_ms = 5\n",
    .real_clock = TRUE,
    .exposure_us = 2000,
};

static void test_wrong_parts(void) {
    static const char *const keys[] = {"part = nothing\n", "world = missing.conf\n"};
    g_autoptr(Clock) clock = clock_new_virtual();
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        g_autofree char *text =
            g_strconcat("[camera x]\n", i ? "" : "world = world.conf\n", keys[i], NULL);
        g_autoptr(Config) config = config_parse(text, RIG, NULL);
        const struct config_section *section = config_find(config, "camera", "x");
        g_autoptr(GError) error = NULL;
        g_assert_null(camera_open(&sim_camera_driver, section, NULL, clock, &error));
        g_assert_nonnull(error);
        g_autoptr(GError) second = NULL;
        g_assert_null(axis_open(&sim_axis_driver, section, NULL, clock, &second));
        g_assert_nonnull(second);
    }
}

static gpointer close_later(gpointer fd) {
    g_usleep(300 * 1000);
    close(GPOINTER_TO_INT(fd));
    return NULL;
}

/* A descriptor that another thread closes late is none that was left open; one that stays is. */
static void test_late_close(void) {
    g_main_context_iteration(NULL, FALSE); /* opens its own */
    const int files = conformance_open_files();
    GThread *thread = g_thread_new("close", close_later, GINT_TO_POINTER(dup(0)));
    conformance_expect_files(&door, files, WAIT_S);
    g_thread_join(thread);
    if (g_test_subprocess()) {
        g_assert_cmpint(dup(0), >=, 0);
        conformance_expect_files(&door, files, 1);
        return;
    }
    g_test_trap_subprocess("/conformance/late-close", 0, G_TEST_SUBPROCESS_DEFAULT);
    g_test_trap_assert_failed();
    g_test_trap_assert_stderr("*conformance_open_files() <= files*");
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    conformance_axis(&sim_axis_driver, &turntable);
    conformance_axis(&sim_axis_driver, &slide);
    conformance_lamps(&sim_lamps_driver, &bank);
    conformance_camera(&sim_camera_driver, &camera);
    conformance_camera(&sim_camera_driver, &quick_camera);
    conformance_laser(&sim_laser_driver, &laser);
    conformance_interlock(&sim_interlock_driver, &door);
    g_test_add_func("/conformance/late-close", test_late_close);
    g_test_add_func("/options/wrong-parts", test_wrong_parts);
    return g_test_run();
}
