// Logs an MPU-6050 at 200 Hz to an SD card: counts at +-4 g and +-500 deg/s, stamps in microseconds,
// the temperature in degC. A task reads the sensor while loop() writes, as a card may pause for
// 100 ms; the queue holds five seconds.
#include <SD.h>
#include <Wire.h>

struct Row {
  uint32_t stamp;
  int16_t value[7];
};
QueueHandle_t rows;
File file;

void set(uint8_t address, uint8_t value) {
  Wire.beginTransmission(0x68);
  Wire.write(address);
  Wire.write(value);
  Wire.endTransmission();
}

void sample(void *) {
  TickType_t last = xTaskGetTickCount();
  for (;;) {
    vTaskDelayUntil(&last, pdMS_TO_TICKS(5));  // 200 Hz
    Row row = {micros()};
    Wire.beginTransmission(0x68);
    Wire.write(0x3B);
    Wire.endTransmission(false);
    Wire.requestFrom(0x68, 14);
    for (int16_t &value : row.value) {
      uint16_t high = Wire.read();
      value = high << 8 | Wire.read();
    }
    xQueueSend(rows, &row, 0);
  }
}

void setup() {
  Wire.begin();
  Wire.setClock(400000);
  set(0x6B, 1);  // wake up; clock of the gyroscope
  set(0x1A, 2);  // low-pass filter at 94 Hz
  set(0x1B, 8);  // +-500 deg/s
  set(0x1C, 8);  // +-4 g
  SD.begin();
  file = SD.open("/log.csv", FILE_WRITE);
  file.println("micros,ax [lsb],ay [lsb],az [lsb],temperature,gx [lsb],gy [lsb],gz [lsb]");
  rows = xQueueCreate(1000, sizeof(Row));
  xTaskCreatePinnedToCore(sample, "sample", 4096, nullptr, 10, nullptr, 0);
}

void loop() {
  Row row;
  xQueueReceive(rows, &row, portMAX_DELAY);
  file.print(row.stamp);
  for (int i = 0; i < 7; i++) {
    file.print(',');
    if (i == 3) file.print(row.value[i] / 340.0 + 36.53);
    else file.print(row.value[i]);
  }
  file.println();
  static int written = 0;
  if (++written % 200 == 0) file.flush();  // once a second
}
