#include "base/config.h"
#include "drivers/device.h"
#include "lib/test.h"

#include <gio/gio.h>

TEST(parts) {
    g_autoptr(GError) error = NULL;
    device_error_set(&error, DEVICE_ERROR_TIMEOUT, "axis arc",
                     "no answer within %d ms" ERROR_ADVICE "check %s", 800, "its cable");
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpstr(error->message, ==, "axis arc: no answer within 800 ms; check its cable");
    g_assert_cmpstr(error_details_subject(error), ==, "axis arc");
    g_assert_cmpstr(error_details_what(error), ==, "no answer within 800 ms");
    g_assert_cmpstr(error_details_advice(error), ==, "check its cable");
    g_assert_cmpstr(error_details_text(error), ==, "no answer within 800 ms; check its cable");
    g_assert_null(error_details_file(error));
}

/* A semicolon in a text is not advice; a second advice belongs to the first. */
TEST(semicolons) {
    g_autoptr(GError) plain =
        device_error_new(DEVICE_ERROR_RANGE, NULL, "there is no lamp 9; it has 0 to 7");
    g_autoptr(GError) two =
        device_error_new(DEVICE_ERROR_STALLED, NULL, "at %d°: %s" ERROR_ADVICE "then home it", 3,
                         "stalled" ERROR_ADVICE "see what blocks it");
    g_assert_null(error_details_advice(plain));
    g_assert_null(error_details_subject(plain));
    g_assert_cmpstr(error_details_text(plain), ==, plain->message);
    g_assert_cmpstr(two->message, ==, "at 3°: stalled; see what blocks it; then home it");
    g_assert_cmpstr(error_details_what(two), ==, "at 3°: stalled");
    g_assert_cmpstr(error_details_advice(two), ==, "see what blocks it; then home it");
}

/* Higher layers add the details that a lower layer does not know, and copies keep all details. */
TEST(added) {
    g_autoptr(GError) error =
        device_error_new(DEVICE_ERROR_PROTOCOL, NULL, "refused" ERROR_ADVICE "check the address");
    g_prefix_error(&error, "watchdog_register: ");
    error_details_add_subject(&error, "lamps bank");
    error_details_add_place(&error, "rig.conf", 12, "[lamps bank]");
    g_autoptr(GError) copy = g_error_copy(error);
    g_clear_error(&error);
    g_assert_cmpstr(copy->message, ==,
                    "rig.conf:12: [lamps bank]: lamps bank: watchdog_register: refused; "
                    "check the address");
    g_assert_cmpstr(error_details_subject(copy), ==, "lamps bank");
    g_assert_cmpstr(error_details_file(copy), ==, "rig.conf");
    g_assert_cmpstr(error_details_advice(copy), ==, "check the address");
    g_assert_cmpstr(error_details_text(copy), ==, "watchdog_register: refused; check the address");
}

TEST(config) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Config) config = config_parse("[axis arc]\nspeed = 9\n", "rig.conf", &error);
    g_assert_no_error(error);
    config_set_error(&error, CONFIG_ERROR_VALUE, config_find(config, "axis", "arc"), "speed",
                     "%d is too fast", 9);
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE);
    g_assert_cmpstr(error->message, ==, "rig.conf:2: [axis arc] speed: 9 is too fast");
    g_assert_cmpstr(error_details_file(error), ==, "rig.conf");
}

TEST(other_domains) {
    g_autoptr(GError) error = g_error_new(G_FILE_ERROR, G_FILE_ERROR_NOENT, "x: gone; find it");
    GError *none = NULL;
    error_details_add_subject(&error, "camera top");
    error_details_add_subject(&none, "camera top");
    error_details_add_subject(NULL, "camera top");
    g_assert_null(none);
    g_assert_cmpstr(error->message, ==, "camera top: x: gone; find it");
    g_assert_null(error_details_subject(error));
    g_assert_null(error_details_advice(error));
    g_assert_cmpstr(error_details_what(error), ==, error->message);
}
