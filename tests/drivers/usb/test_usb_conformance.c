#include "conformance/conformance.h"

#include "usb/relays.h"
#include "usb/tic.h"
#include "virtual/testbed.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"

/* What every driver must do, asked of the USB drivers, in real time, all plugged in together. The
 * second board's HID interface is not its first. */
static struct conformance tic = {
    .name = "tic-axis",
    .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nmin_deg = 0\nmax_deg = 38\n"
               "speed_deg_s = 60\naccel_deg_s2 = 600\nbacklash_deg = 0.5\nsettle_ms = 10\n"
               "poll_ms = 10\n",
    .real_clock = TRUE,
};

static struct conformance relays = {
    .name = "usb-relays",
    .section = "[lamps test]\ndriver = usb-relays\nserial = LAMPS\n",
    .real_clock = TRUE,
};

static struct conformance laser = {
    .name = "usb-relay-laser",
    .section = "[laser test]\ndriver = usb-relay-laser\nserial = LASER\nrelay = 2\n",
    .real_clock = TRUE,
};

/* A device that does not answer does not obey either. */
static void fail(gpointer usb, enum conformance_fault fault) {
    virtual_usb_set_fault(usb, fault == CONFORMANCE_WELL ? VIRTUAL_USB_WELL : VIRTUAL_USB_SILENT);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    g_test_init(&argc, &argv, NULL);
    g_autoptr(VirtualTic) tic_device = virtual_tic_new("TIC", 1, 4000, 100);
    g_autoptr(VirtualRelays) lamps_board = virtual_relays_new("USBRelay4", "LAMPS", 2, FALSE);
    g_autoptr(VirtualRelays) laser_board = virtual_relays_new("USBRelay2", "LASER", 3, TRUE);
    tic.fail = relays.fail = laser.fail = fail;
    tic.fail_data = virtual_tic_usb(tic_device);
    relays.fail_data = virtual_relays_usb(lamps_board);
    laser.fail_data = virtual_relays_usb(laser_board);
    conformance_axis(&tic_axis_driver, &tic);
    conformance_lamps(&usb_relays_driver, &relays);
    conformance_laser(&usb_relay_laser_driver, &laser);
    int failed = g_test_run();
    g_assert_cmphex(virtual_relays_state(lamps_board), ==, 0);
    g_assert_cmphex(virtual_relays_state(laser_board), ==, 0);
    return failed;
}
