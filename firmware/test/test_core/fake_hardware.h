// Simulated hardware in memory, including its failures.
#pragma once

#include <hardware.h>

#include <array>
#include <vector>

using Bytes = std::vector<uint8_t>;
using EepromImage = std::array<uint8_t, ccr::kEepromSize>;

inline EepromImage erased_eeprom() {
  EepromImage image;
  image.fill(0xFF);
  return image;
}

struct FakeHardware final : ccr::Hardware {
  EepromImage eeprom = erased_eeprom();
  Bytes sent;
  uint32_t now_us = 0;
  unsigned room = 255;
  bool is_eeprom_busy = false;
  int worn_out_address = -1;
  unsigned eeprom_writes = 0;
  std::array<unsigned, ccr::kEepromSize> cell_writes = {};
  bool is_stop_open = false;
  uint8_t supply = 0;
  bool is_supply_on = false;
  bool is_led_on = false;
  uint16_t free_stack = ccr::kStackNotMeasured;

  uint16_t capabilities() override { return ccr::capabilities::kEeprom; }
  uint32_t time_us() override { return now_us; }
  bool has_room(uint8_t size) override { return size <= room; }
  void send(const uint8_t* frame, uint8_t size) override {
    sent.insert(sent.end(), frame, frame + size);
  }
  bool is_eeprom_ready() override { return !is_eeprom_busy; }
  uint8_t read_eeprom(uint16_t address) override { return eeprom.at(address); }
  void write_eeprom(uint16_t address, uint8_t byte) override {
    ++eeprom_writes;
    ++cell_writes.at(address);
    if (address != worn_out_address) {
      eeprom.at(address) = byte;
    }
  }
  bool is_emergency_stop_open() override { return is_stop_open; }
  uint8_t supply_reading() override { return supply; }
  void set_servo_supply(bool is_on) override { is_supply_on = is_on; }
  void set_led(bool is_on) override { is_led_on = is_on; }
  uint16_t least_free_stack() override { return free_stack; }
};
