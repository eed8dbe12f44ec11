#include "lib/modbus_rig.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

/* A device in a process of its own, since the suites count this one's open files. It ends with its
 * input. Returns where it can be reached; g_free(). */
static char *serve(int *ret_input) {
    int input[2], output[2];
    char bus[64] = "";
    g_assert_cmpint(pipe2(input, O_CLOEXEC), ==, 0);
    g_assert_cmpint(pipe2(output, O_CLOEXEC), ==, 0);
    pid_t child = fork();
    g_assert_cmpint(child, >=, 0);
    if (child == 0) {
        VirtualModbus *device = modbus_rig_device(FALSE);
        const char *name = virtual_modbus_bus(device);
        close(input[1]);
        _exit(write(output[1], name, strlen(name)) < 0 || read(input[0], bus, 1) < 0);
    }
    close(input[0]);
    close(output[1]);
    g_assert_cmpint(read(output[0], bus, sizeof bus - 1), >, 0);
    close(output[0]);
    *ret_input = input[1];
    return g_strdup(bus);
}

int main(int argc, char **argv) {
    int input;
    g_autofree char *bus = serve(&input);
    g_test_init(&argc, &argv, NULL);
    modbus_rig_conformance(bus, "modbus-tcp");
    modbus_rig_conformance_watchdog(bus, "modbus-tcp-register", FALSE);
    modbus_rig_conformance_watchdog(bus, "modbus-tcp-pulses", TRUE);
    int result = g_test_run();
    close(input);
    wait(NULL);
    return result;
}
