/* The boards: pins as their firmware uses them (firmware/boards). */
#include "parts.h"

#include <string.h>

enum {
    PORT_A = 0x20,
    PORT_B = 0x23,
    PORT_D = 0x29,
    PORT_E = 0x2C,
    PORT_H = 0x100,
    PORT_L = 0x109,
};

static const chip_t CHIPS[] = {
    {
        .board = "uno",
        .mcu = "atmega328p",
        .servos = 2,
        .pin = {{PORT_B, 1}, {PORT_B, 2}, [RIG_SERVO_SUPPLY] = {PORT_B, 0}, [RIG_LED] = {PORT_B, 5}},
        .output = {{0, 0}, {0, 1}},
        .emergency_stop = {PORT_D, 7},
        .timers = 1,
        .channels = 2,
        .timer = {{'1', 0x80}},
        .ports = {PORT_B},
    },
    {
        .board = "mega2560",
        .mcu = "atmega2560",
        .servos = RIG_SERVO_PINS,
        .pin = {{PORT_B, 5}, {PORT_E, 3}, {PORT_H, 3}, {PORT_L, 3},
                {PORT_B, 6}, {PORT_E, 4}, {PORT_H, 4}, {PORT_L, 4},
                {PORT_E, 5}, {PORT_H, 5}, {PORT_L, 5}, {PORT_B, 7},
                [RIG_SERVO_SUPPLY] = {PORT_A, 0}, [RIG_LED] = {PORT_A, 2}},
        .output = {{0, 0}, {1, 0}, {2, 0}, {3, 0}, {0, 1}, {1, 1},
                   {2, 1}, {3, 1}, {1, 2}, {2, 2}, {3, 2}, {0, 2}},
        .emergency_stop = {PORT_A, 1},
        .timers = 4,
        .channels = 3,
        .timer = {{'1', 0x80}, {'3', 0x90}, {'4', 0xA0}, {'5', 0x120}},
        .ports = {PORT_A, PORT_B, PORT_E, PORT_H, PORT_L},
    },
};

const chip_t *find_chip(const char *board) {
    for (size_t i = 0; i < sizeof CHIPS / sizeof *CHIPS; i++)
        if (strcmp(CHIPS[i].board, board) == 0) return &CHIPS[i];
    return NULL;
}
