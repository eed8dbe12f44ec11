/* What virtual devices do to the world, through the real drivers: the world's state is the truth.
 */
#include "conformance/conformance.h"
#include "lib/camera_open.h"

#include "lib/ok.h"
#include "lib/test.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "v4l2/v4l2.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/testbed.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"

#define WORLD SOURCE_DIR "/tests/small/world.conf"

struct heard {
    int n;
    GError *error;
};

static World *get_world(void) {
    World *world = ok(world_get(WORLD, ERR));
    return world;
}

static struct world_state state_of(World *world) {
    struct world_state state;
    world_snapshot(world, g_get_monotonic_time() - 1000, 1000, &state);
    return state;
}

static void note(struct heard *heard, const GError *error) {
    g_assert_no_error(error);
    heard->n++;
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    note(data, error);
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    note(data, error);
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    note(data, error);
}

static void set_lamp(LampBank *bank, struct heard *heard, int index, gboolean on) {
    heard->n = 0;
    ok(lamps_set(bank, index, on, ERR));
    conformance_wait(bank->device.clock, &heard->n, 1, 10);
}

TEST(lamps) {
    static const struct conformance with = {
        .section = "[lamps test]\ndriver = usb-relays\nserial = LAMPS\n"};
    g_autoptr(World) world = get_world();
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) board = virtual_relays_new("USBRelay4", "LAMPS", 1, FALSE);
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    struct heard heard = {0};
    GError *error = NULL;
    g_assert_true(virtual_relays_link(board, 0, world, "lamp lamp60", NULL));
    g_assert_true(virtual_relays_link(board, 2, world, "lamp lamp30", NULL));
    g_autoptr(LampBank) bank = lamps_open(&usb_relays_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    lamps_listen(bank, on_lamp, &heard);
    int lamp30 = world_find_lamp(world, "lamp30"), lamp60 = world_find_lamp(world, "lamp60");

    set_lamp(bank, &heard, 2, TRUE);
    conformance_pass(clock, world_lamp_warm_up_s(world) + 0.01);
    g_assert_cmpfloat(state_of(world).lamp_output[lamp30], ==, 1);
    g_assert_cmpfloat(state_of(world).lamp_output[lamp60], ==, 0);
    set_lamp(bank, &heard, 1, TRUE); /* on this relay nothing hangs */
    set_lamp(bank, &heard, 2, FALSE);
    conformance_pass(clock, 0.01);
    g_assert_cmpfloat(state_of(world).lamp_output[lamp30], ==, 0);
    set_lamp(bank, &heard, 0, TRUE);
    conformance_pass(clock, 0.01);
    g_assert_cmpfloat(state_of(world).lamp_output[lamp60], >, 0);
    virtual_relays_lose_power(board);
    conformance_pass(clock, 0.01);
    g_assert_cmpfloat(state_of(world).lamp_output[lamp60], ==, 0);
}

TEST(laser) {
    static const struct conformance with = {
        .section = "[laser test]\ndriver = usb-relay-laser\nserial = LASER\nrelay = 2\n"};
    g_autoptr(World) world = get_world();
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) board = virtual_relays_new("USBRelay2", "LASER", 2, TRUE);
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    struct heard heard = {0};
    int index = world_find_laser(world, "laser30");
    g_assert_true(virtual_relays_link(board, 1, world, "laser laser30", NULL));
    Laser *laser = ok(laser_open(&usb_relay_laser_driver, section, NULL, clock, ERR));
    laser_listen(laser, on_laser, &heard);
    g_assert_false(state_of(world).laser_on[index]);
    g_assert_true(laser_set(laser, TRUE, NULL));
    conformance_wait(clock, &heard.n, 1, 10);
    g_assert_true(state_of(world).laser_on[index]);
    laser_close(laser);
    g_assert_false(state_of(world).laser_on[index]);
}

TEST(motor) {
    static const struct conformance with = {
        .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nmin_deg = 0\n"
                   "max_deg = 38\nspeed_deg_s = 60\naccel_deg_s2 = 1200\npoll_ms = 10\n"};
    g_autoptr(World) world = get_world();
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualTic) tic = virtual_tic_new("TIC", 3, 4000, 100);
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    struct heard heard = {0};
    GError *error = NULL;
    g_assert_true(virtual_tic_link(tic, world, "sweep laser60", 100, 1500, NULL));
    int index = world_find_laser(world, "laser60");
    g_autoptr(Axis) axis = axis_open(&tic_axis_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat_with_epsilon(state_of(world).sweep_deg[index], -14, 1e-9);
    axis_listen(axis, on_axis, &heard);
    g_assert_true(axis_home(axis, NULL));
    conformance_wait(clock, &heard.n, 1, 10);
    g_assert_true(axis_move(axis, 22.5, NULL));
    conformance_wait(clock, &heard.n, 2, 10);
    /* Homing's zero is where the reverse switch opens again, at most a step off the motor's 0. */
    g_assert_cmpfloat_with_epsilon(state_of(world).sweep_deg[index], 22.5 - 15, 0.1);
}

struct eye {
    struct heard heard;
    Frame *frame;
};

static void on_camera(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    struct eye *eye = data;
    if (event == CAMERA_EXPOSED)
        return;
    note(&eye->heard, error);
    g_clear_pointer(&eye->frame, frame_unref);
    eye->frame = frame_ref(frame);
}

/* Mean above black of a picture taken now. */
static double look(Camera *camera, struct eye *eye, guint64 shot) {
    double sum = 0;
    eye->heard.n = 0;
    g_assert_true(camera_trigger(camera, shot, NULL));
    conformance_wait(camera->device.clock, &eye->heard.n, 1, 20);
    int n = eye->frame->width * eye->frame->height;
    for (int i = 0; i < n; i++)
        sum += eye->frame->pixels[i] - camera->format.black_level;
    return sum / n;
}

/* What a world's camera sees by V4L2, with a lamp that hangs on a relay at USB. */
TEST(lamp_seen) {
    static const struct conformance lamps_with = {.section = "[lamps test]\ndriver = usb-relays\n"};
    static const struct conformance camera_with = {
        .section = "[camera test]\ndriver = v4l2-camera\nblack_level = 64\nframe_rate = 50\n"};
    g_autoptr(World) world = get_world();
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) board = virtual_relays_new("USBRelay2", "LAMPS", 1, FALSE);
    g_autoptr(VirtualV4l2) device =
        virtual_v4l2_new_world(&(struct virtual_v4l2_config){0}, world, "cam30", NULL);
    const struct config_section *lamps_section, *camera_section;
    g_autoptr(Config) lamps_config = conformance_config(&lamps_with, "", &lamps_section);
    g_autoptr(Config) camera_config = conformance_config(&camera_with, "", &camera_section);
    struct heard heard = {0};
    struct eye eye = {0};
    GError *error = NULL;
    g_assert_true(virtual_relays_link(board, 1, world, "lamp lamp30", NULL));
    g_autoptr(LampBank) bank = lamps_open(&usb_relays_driver, lamps_section, NULL, clock, &error);
    g_assert_no_error(error);
    lamps_listen(bank, on_lamp, &heard);
    g_autoptr(Camera) camera =
        camera_open(&v4l2_camera_driver, camera_section, NULL, clock, &error);
    g_assert_no_error(error);
    camera_listen(camera, on_camera, &eye);
    struct camera_settings settings = {8000, 0};
    g_assert_true(camera_configure(camera, &settings, NULL));
    g_assert_true(camera_arm(camera, NULL));

    g_assert_cmpfloat_with_epsilon(look(camera, &eye, 1), 0, 1);
    set_lamp(bank, &heard, 1, TRUE);
    conformance_pass(clock, world_lamp_warm_up_s(world));
    double lit = look(camera, &eye, 2);
    settings.exposure_us = 4000;
    g_assert_true(camera_configure(camera, &settings, NULL));
    double half = look(camera, &eye, 3);
    set_lamp(bank, &heard, 1, FALSE);
    g_assert_cmpfloat_with_epsilon(look(camera, &eye, 4), 0, 1);
    g_assert_cmpfloat(lit, >, 100);
    g_assert_cmpfloat_with_epsilon(half / lit, 0.5, 0.01);
    g_clear_pointer(&eye.frame, frame_unref);
}

TEST(unknown) {
    static const char *const wrong[] = {"", "lamp", "lamp ", "lamp nobody", "laser lamp30", "door"};
    g_autoptr(World) world = get_world();
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        struct world_part part = {0};
        GError *error = NULL;
        g_assert_false(world_part_find(world, wrong[i], &part, &error));
        g_assert_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND);
        g_assert_null(part.world);
        g_clear_error(&error);
    }
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
