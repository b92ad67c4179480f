"""Chromium on a leash: reads one JSON order a line, answers with one JSON object a line.

    {"do": "open", "url": U}    {"do": "text", "css": S}    {"do": "attr", "css": S, "name": N}
    {"do": "click", "css": S}   {"do": "shot", "file": F}   {"do": "errors"}   {"do": "script", "js": J}
    {"do": "size", "width": W, "height": H, "touch": T}     of the page without the browser's frame, in pixels; whether
                                                            it is touched, as on a phone, or has a mouse

The answer is {"value": ...} or {"error": "..."}. Ends with standard input.
"""

import json
import sys

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By

FLAGS = (
    "--headless --no-sandbox --disable-dev-shm-usage --disable-quic --no-first-run --disable-sync "
    "--disable-background-networking --disable-component-update --window-size=1600,1000 "
    "--enable-unsafe-swiftshader --use-angle=swiftshader --force-prefers-reduced-motion"
)


def start():
    options = Options()
    options.binary_location = "/usr/bin/chromium"
    for flag in FLAGS.split():
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))


def carry_out(driver, order):
    def find():
        return driver.find_element(By.CSS_SELECTOR, order["css"])

    match order["do"]:
        case "open":
            return driver.get(order["url"])
        case "text":
            return find().text
        case "attr":
            return find().get_attribute(order["name"])
        case "click":
            return find().click()
        case "shot":
            return driver.save_screenshot(order["file"])
        case "size":
            is_touched = order.get("touch", False)
            driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": is_touched})
            metrics = {"width": order["width"], "height": order["height"], "deviceScaleFactor": 1, "mobile": is_touched}
            return driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        case "script":
            return driver.execute_script(order["js"])
        case "errors":
            return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]


def main():
    driver = start()
    print(json.dumps({"value": "ready"}), flush=True)
    try:
        for line in sys.stdin:
            try:
                answer = {"value": carry_out(driver, json.loads(line))}
            except Exception as error:  # noqa: BLE001: whatever it is, the test must hear of it
                answer = {"error": str(error).splitlines()[0]}
            print(json.dumps(answer), flush=True)
    finally:
        driver.quit()


if __name__ == "__main__":
    main()
