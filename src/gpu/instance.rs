//! The Vulkan loader, the instance, and the messages of the validation layer.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, OnceLock};

use anyhow::Result;
use ash::{Entry, ext, khr, vk};
use raw_window_handle::RawDisplayHandle;

use super::error::{Unavailable, describe};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// The messages of the validation layer and of the missing-barrier check.
pub(super) type Messages = Arc<Mutex<Vec<String>>>;

/// The first instance lives as long as the program. Without it, the loader would unload the drivers with the last
/// instance, and a driver's library can be loaded again only a few times because its thread-local storage is not freed.
static FIRST: OnceLock<Arc<Instance>> = OnceLock::new();

/// The state of the validation layer, the missing-barrier check, robust buffer access and the stage markers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Validation {
    Off,
    /// The layer is on if it is installed. The other checks are on.
    IfInstalled,
    /// All checks are on; a missing layer is an error.
    Required,
}

pub(super) struct Instance {
    pub raw: ash::Instance,
    pub messages: Messages,
    /// True if the validation layer is on.
    pub validated: bool,
    /// True if objects and commands can be named for the validation layer and for capture tools.
    pub has_debug_utils: bool,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub entry: Entry,
}

impl Instance {
    /// Loads Vulkan with the validation layer as `validation` asks, and with the extensions for windows on `display`.
    pub fn new(validation: Validation, display: Option<RawDisplayHandle>) -> Result<Arc<Self>> {
        // SAFETY: clause 5's counterpart for the host: the system's Vulkan loader is trusted like its C library.
        let entry = unsafe { Entry::load() }.map_err(|e| {
            Unavailable(format!(
                "the Vulkan loader cannot be loaded ({e}): install libvulkan1 (Debian, Ubuntu), vulkan-loader (Fedora) \
                 or vulkan-icd-loader (Arch)"
            ))
        })?;
        // SAFETY: the entry is alive; enumeration has no other precondition.
        let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
        let has_layer = layers.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER));
        if validation == Validation::Required && !has_layer {
            return Err(Unavailable(
                "validation was asked for but VK_LAYER_KHRONOS_validation is not installed: \
                 install vulkan-validationlayers"
                    .into(),
            )
            .into());
        }
        let validate = validation != Validation::Off && has_layer;
        let offers = |layer: Option<&CStr>, name: &CStr| {
            // SAFETY: as above.
            let extensions = unsafe { entry.enumerate_instance_extension_properties(layer) }.unwrap_or_default();
            extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name))
        };
        let has_debug_utils = offers(None, ext::debug_utils::NAME);
        let mut extensions = Vec::new();
        if has_debug_utils {
            extensions.push(ext::debug_utils::NAME.as_ptr());
        }
        // Without this extension the loader hides drivers on top of other interfaces, like MoltenVK.
        let lists_portable = offers(None, khr::portability_enumeration::NAME);
        if lists_portable {
            extensions.push(khr::portability_enumeration::NAME.as_ptr());
        }
        if let Some(display) = display {
            let needed = ash_window::enumerate_required_extensions(display)
                .map_err(|e| Unavailable(format!("Vulkan has no windows on this display ({e})")))?;
            // SAFETY: ash-window returns static strings.
            let missing = needed.iter().map(|name| unsafe { CStr::from_ptr(*name) }).find(|name| !offers(None, name));
            if let Some(missing) = missing {
                let missing = missing.to_string_lossy();
                return Err(Unavailable(format!("Vulkan lacks {missing}, which windows of this display need")).into());
            }
            extensions.extend(needed);
        }
        let checks_synchronization = validate && offers(Some(VALIDATION_LAYER), ext::validation_features::NAME);
        if checks_synchronization {
            extensions.push(ext::validation_features::NAME.as_ptr());
        }
        let layers = if validate { vec![VALIDATION_LAYER.as_ptr()] } else { Vec::new() };

        let messages = Messages::default();
        let mut messenger_info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(collect))
            .user_data(Arc::as_ptr(&messages).cast::<c_void>().cast_mut());
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let application = vk::ApplicationInfo::default().application_name(c"smalto").api_version(vk::API_VERSION_1_3);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .flags(if lists_portable {
                vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR
            } else {
                vk::InstanceCreateFlags::empty()
            })
            .enabled_extension_names(&extensions)
            .enabled_layer_names(&layers);
        let listens = validate && has_debug_utils;
        if listens {
            info = info.push_next(&mut messenger_info);
        }
        if checks_synchronization {
            info = info.push_next(&mut features);
        }
        // SAFETY: clause 4, layers and extensions were found above; `messages` outlives the instance.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => Unavailable(NO_DRIVER.to_owned()).into(),
            _ => describe("vkCreateInstance", result),
        })?;
        messenger_info.p_next = std::ptr::null();
        let mut instance = Self { raw, messages, validated: validate, has_debug_utils, messenger: None, entry };
        if listens {
            let loader = ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            // SAFETY: clause 1, the messenger and its user data live in this Instance and go before the instance.
            let messenger = unsafe { loader.create_debug_utils_messenger(&messenger_info, None) };
            instance.messenger = Some((loader, messenger.map_err(|e| describe("vkCreateDebugUtilsMessengerEXT", e))?));
        }
        let instance = Arc::new(instance);
        let _ = FIRST.get_or_init(|| instance.clone());
        Ok(instance)
    }
}

pub(super) const NO_DRIVER: &str = "no Vulkan driver is installed: install your GPU's driver, or the software device \
    lavapipe from mesa-vulkan-drivers (Debian, Ubuntu, Fedora) or vulkan-swrast (Arch)";

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: clause 1, this is the last reference.
        unsafe {
            if let Some((loader, messenger)) = &self.messenger {
                loader.destroy_debug_utils_messenger(*messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

/// Messages about a swapchain whose size differs from its window's. On X11 the user can resize the window between the
/// query of its size and the creation of the swapchain. Such a swapchain is stale at once and is replaced.
const RESIZED_MEANWHILE: [&str; 2] =
    ["VUID-VkSwapchainCreateInfoKHR-imageExtent-01274", "VUID-VkSwapchainCreateInfoKHR-pNext-07781"];

/// The callback of the validation layer. Stores the message.
unsafe extern "system" fn collect(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes valid data and the user data given at creation, alive by clause 1.
    let (message, messages) = unsafe { ((*data).message_as_c_str(), &*messages.cast::<Mutex<Vec<String>>>()) };
    let message = message.map_or_else(|| "a message without text".into(), |m| m.to_string_lossy().into_owned());
    if !RESIZED_MEANWHILE.iter().any(|id| message.contains(id)) {
        messages.lock().expect("no holder of the messages panics").push(message);
    }
    vk::FALSE
}
